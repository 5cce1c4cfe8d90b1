"""`python -m tests.trust.second_bench`, from the repository's root."""

import os
import sys

# sums over threads differ in their last digits, and a strength is found step by step from such sums
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from .command import main

if __name__ == "__main__":
    sys.exit(main())
