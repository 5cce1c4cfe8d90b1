"""The reference paper redone: recordings from its printed parameters, its own procedures, then ours beside them."""
