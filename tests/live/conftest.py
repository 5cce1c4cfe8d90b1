"""Modules that the tests of the live bench share."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import pytest
from stream import TOML


@pytest.fixture
def toml(tmp_path: Path) -> Path:
    """campaign.toml of a bench whose material has one branch."""
    path = tmp_path / "campaign.toml"
    path.write_text(TOML)
    return path
