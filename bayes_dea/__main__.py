"""`python -m bayes_dea` is `bayes-dea`."""

from .cli import main

main()
