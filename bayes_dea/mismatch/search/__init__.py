"""The search for what was left out: effects on grids, refits, pairs of them, and the probabilities of all."""
