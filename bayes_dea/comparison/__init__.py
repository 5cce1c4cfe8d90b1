"""Which structure the recordings support: evidence, prediction, and what is one and the same."""
