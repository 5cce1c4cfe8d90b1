"""Averaging a model with effects over blocks: a piece of the rows at a time, and by hand."""

import numpy as np
import pytest

from bayes_dea.likelihood import plant_group
from bayes_dea.models.nodes import Nodes
from bayes_dea.noise.blocks import log_blocks

N = 5_000


@pytest.fixture(scope="module")
def given():
    rng = np.random.default_rng(1)
    time_s = np.cumsum(rng.uniform(0.5e-3, 1.5e-3, N))
    volts = np.where((np.arange(N) // 800) % 2, 700.0, 0.0)
    row = np.unique(np.concatenate([[0, N - 1], rng.integers(0, N, 400)]))
    nodes = Nodes(time_s[row], volts[row], row, N)
    observed = rng.random(N) > 0.1
    blocks = log_blocks(time_s, volts, None, y=np.where(observed, 1.0, np.nan), mask=~observed)
    return nodes, time_s, blocks, observed


def test_it_is_the_mean_over_the_observed_rows_of_straight_lines_between_nodes(given):
    nodes, time_s, blocks, observed = given
    values = np.random.default_rng(2).standard_normal(nodes.size)
    every = np.interp(time_s, nodes.time_s, values)
    by_hand = [every[a:b][observed[a:b]].mean() for a, b in zip(blocks.start, blocks.stop, strict=True)]
    np.testing.assert_allclose(plant_group.averaging(*given) @ values, by_hand, rtol=0, atol=1e-13)


@pytest.mark.parametrize("piece", [97, 1024])
def test_in_pieces_as_at_once(given, monkeypatch, piece):
    whole = plant_group.averaging(*given)
    monkeypatch.setattr(plant_group, "PIECE", piece)
    np.testing.assert_allclose(plant_group.averaging(*given).toarray(), whole.toarray(), rtol=0, atol=1e-15)
