"""Creeps that were read fast behind their edges and slowly in between, with noise that a filter has left."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.mismatch.diagnosis import diagnose


def captured(campaign):
    """The campaign with every 20th row of the creeps alone, but for a second around each edge of the command."""
    out = []
    for r in campaign.recordings:
        if r.kind == "creep":
            u, t = r.columns["voltage_V"], r.time_s
            edges = t[np.flatnonzero(np.diff(u, prepend=u[0]))]
            near = np.any([(t > e - 0.02) & (t < e + 1.0) for e in edges], axis=0)
            kept = near | (np.arange(t.size) % 20 == 0)
            r = replace(r, columns={name: c[kept] for name, c in r.columns.items()})
        out.append(r)
    return replace(campaign, recordings=tuple(out))


@pytest.mark.long
def test_rows_that_are_correlated_otherwise_are_no_mismatch():
    """0.7 from row to row at 1 kHz, nothing at 50 Hz."""
    s = diagnose(captured(concealed(rho=0.7)), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "none", s["statement"]
    assert s["mismatch"]["p_value"] > 1e-3
    assert not any("mains" in w for w in s["warnings"])


@pytest.mark.long
def test_an_effect_is_named_and_measured_there():
    s = diagnose(captured(concealed({"series_resistance": {"R_s_ohm": 1.2e5}}, rho=0.7)), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "series_resistance", s["statement"]
    own = s["hypotheses"][0]["parameters"]["R_s_ohm"]
    assert own["q05"] < 1.3e5
    assert own["q95"] > 1.1e5
    assert s["adequacy_p_value"] > 1e-3
