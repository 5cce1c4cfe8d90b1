"""The calibrated model as state space, for MATLAB, python-control and whoever reads CSV."""
