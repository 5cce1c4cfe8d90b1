"""What is believed of a specimen is that of this specimen, however the others are called."""

from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.assemble import assemble
from bayes_dea.design.belief import of_posterior
from bayes_dea.models.model import build_model
from bayes_dea.predict_recordings import conditional_gain


def specimens(campaign, roles, scale):
    """Recordings of the campaign again as those of specimens, in the order of `roles`, displacements times `scale`."""
    def of(r, specimen):
        columns = {**r.columns, "displacement_m": scale[specimen] * r.columns["displacement_m"]}
        return replace(r, name=f"{specimen}_{r.name}", specimen=specimen, role=roles[specimen], columns=columns)

    return replace(campaign, recordings=tuple(of(r, s) for s in roles for r in campaign.recordings))


@pytest.mark.parametrize("other", ["identify", "validate"])
def test_the_gain_is_that_of_the_first_specimen_to_identify(electric, other):
    both = specimens(electric, {"B": "identify", "A": other}, {"B": 1.03, "A": 0.97})
    posterior = assemble(both, build_model("hooke")).posterior
    assert posterior.specimens == ("B", "A")
    assert [g.specimen for g in posterior.groups] == ["A", "B"]
    z = np.log(1.3e6) + 0.01 * np.random.default_rng(1).standard_normal((4000, 1))
    at = posterior.model.from_prior_coordinates(z)
    q = np.concatenate([at, np.tile(posterior.noise_guess(), (len(at), 1))], axis=1)
    gains = conditional_gain(posterior, q)
    b, a = gains["displacement", "B"][0], gains["displacement", "A"][0]
    if other == "identify":  # the same actuator read by a sensor that shows 6 % more
        assert np.median((1 + b) / (1 + a)) == pytest.approx(1.03 / 0.97, abs=0.02)
    belief = of_posterior(posterior, q, both, np.random.default_rng(2))
    assert belief.gains["displacement"].mean() == pytest.approx(b.mean(), abs=0.002)
    assert abs(belief.gains["displacement"].mean() - a.mean()) > 0.01
    # what the stroke says of the gain goes with the modulus
    assert np.corrcoef(belief.gains["displacement"], z[:, 0])[0, 1] > 0.9
