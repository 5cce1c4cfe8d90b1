"""Fits that are kept belong to the recordings that they were made of."""

from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.design.hypotheses import FitSettings, fitted_beliefs
from bayes_dea.models.model import build_model

HOOKE = {"hooke": build_model("hooke")}


def scaled(campaign, factor):
    """The same names with a displacement that is larger by a factor; made of arrays, so that no file is hashed."""
    return replace(campaign, recordings=tuple(
        replace(r, columns={**r.columns, "displacement_m": factor * r.columns["displacement_m"]})
        for r in campaign.recordings))


def thinner(campaign, factor):
    """The same recordings of an actuator whose layers are thinner."""
    actuator = campaign.recordings[0].actuator
    actuator = replace(actuator, layer_thickness_m=factor * actuator.layer_thickness_m)
    return replace(campaign, recordings=tuple(replace(r, actuator=actuator) for r in campaign.recordings))


# hooke's stroke goes as V^2 / (thickness Y): half of either asks for twice the modulus; memory and gain take a little
@pytest.mark.parametrize(("change", "factor"), [(scaled, 0.5), (thinner, 0.5)])
def test_other_data_of_the_same_name_are_fitted_anew(electric, tmp_path, change, factor):
    def stiffness(campaign):
        beliefs, _ = fitted_beliefs(campaign, HOOKE, 1, FitSettings(draws=400), lambda *_: None, tmp_path)
        return float(np.median(HOOKE["hooke"].physical(beliefs[0].z)["Y_Pa"]))

    assert stiffness(change(electric, factor)) / stiffness(electric) == pytest.approx(1.0 / factor, rel=0.1)
    assert len(list(tmp_path.glob(".checkpoint-*"))) == 2


def test_a_comparison_tells_them_apart_too(electric):
    from bayes_dea.comparison.common import common_data
    from bayes_dea.comparison.run import ComparisonSettings, identity

    kept = [identity(HOOKE["hooke"], common_data(c, list(HOOKE.values())).fingerprint, 1, ComparisonSettings())
            for c in (electric, scaled(electric, 0.5), thinner(electric, 0.9), scaled(electric, 1.0))]
    assert kept[0] not in kept[1:3]
    assert kept[0] == kept[3]
