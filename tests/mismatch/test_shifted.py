"""A damper read a part of a sample late is what a mass with much damping does nearly: it may not be claimed as one."""

import pytest
from concealed_campaigns import concealed
from test_leads import led

from bayes_dea.mismatch.diagnosis import diagnose


@pytest.mark.long
@pytest.mark.parametrize(("d0", "late_s", "seed"), [(1500.0, 3e-4, 3), (800.0, 3.2e-4, 1)])
def test_a_damper_read_late_is_no_mass(d0, late_s, seed):
    found = led(concealed({"parallel_damper": {"d0_Pa_s": d0}}, seed=seed), -late_s)
    s = diagnose(found, "hooke+gm3").summary
    assert s["verdict"] in ("sensor_lag", "parallel_damper")  # nothing here tells these two apart
    assert {"sensor_lag", "parallel_damper"} <= set(s["indistinguishable"])
    assert s["confidence"] < 0.8
    assert s["warnings"][0].startswith("timing: the readings lag the command by 0.3")
