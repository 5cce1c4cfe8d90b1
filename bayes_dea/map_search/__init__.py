"""Where the search for the maximum begins: swarms over what is nonlinear, the rest projected out."""
