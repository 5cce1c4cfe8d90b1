"""How often the import is right, asks, or is wrong, on files of known truth."""

import numpy as np
import pytest
from random_files import random_case
from score import gather, score_all_made, score_all_real, score_made, table


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return score_all_made(tmp_path_factory.mktemp("made"))


def test_files_of_other_programs(made):
    assert not [r for r in made if r.outcome == "wrong"], table(made)
    assert sum(r.outcome == "right" for r in made) >= 0.8 * len(made), table(made)


def test_it_asks_where_the_file_does_not_say(made):
    asked = {r.format for r in made if r.outcome == "asked"}
    assert {
        "sample number only, no rate",
        "Tektronix, monitor and laser both in volts",
        "force and travel, tension or compression not said",
    } <= asked


def test_real_files(shared, made):
    real = score_all_real(shared / "data" / "real")
    assert not [r for r in real if r.outcome == "wrong"], table(real)
    both = gather([*made, *real])
    assert sum(r.outcome == "right" for r in both) >= 0.8 * len(both), table(both)


def test_random_files_are_never_wrong_in_silence(tmp_path):
    rng = np.random.default_rng(20)
    rows = [score_made(random_case(rng, tmp_path / f"file_{i}.csv"), tmp_path / f"out_{i}") for i in range(40)]
    assert not [r for r in rows if r.outcome == "wrong"], table(rows)
    assert sum(r.outcome == "right" for r in rows) >= 0.6 * len(rows), table(rows)
