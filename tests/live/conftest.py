"""Modules that the tests of the live bench share."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
