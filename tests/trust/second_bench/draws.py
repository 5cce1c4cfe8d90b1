"""The two draws that everything is made of."""

import numpy as np


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A draw between low and high, every decade as likely."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def sign(rng: np.random.Generator) -> float:
    """-1 or 1, either equally likely."""
    return float(rng.choice([-1.0, 1.0]))
