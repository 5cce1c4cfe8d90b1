"""Inference that knows nothing of actuators: optimisation, sampling, evidence, importance weights."""
