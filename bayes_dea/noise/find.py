"""What the data alone say about their noise: level, correlation, drop-outs, mains, stuck sensor."""

from bayes_dea.noise.dropouts import find_dropouts
from bayes_dea.noise.edges import find_edges, input_noise
from bayes_dea.noise.flat import Flat, find_flat, stuck_rows
from bayes_dea.noise.mains import Mains, MainsLine, find_mains
from bayes_dea.noise.quiet import QuietNoise, quiet_noise

__all__ = ["Flat", "Mains", "MainsLine", "QuietNoise", "find_dropouts", "find_edges", "find_flat",
           "find_mains", "input_noise", "quiet_noise", "stuck_rows"]
