"""The verbs of the command line, one a file; heavy imports happen inside them."""
