"""What is kept at the top of the repository is the project and nothing that an experiment left there."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
KEPT = {".ci", ".gitignore", "README.md", "bayes_dea", "priors", "pyproject.toml", "reports", "runs", "tests"}


def test_nothing_else_is_kept_there():
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a git repository")
    assert {name.split("/")[0] for name in listed.stdout.splitlines()} == KEPT
