"""Likelihoods: the Gram form for linear models on voltage records, block means for everything else."""
