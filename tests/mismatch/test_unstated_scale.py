"""A sensor whose accuracy nobody stated: its scale may be off, and that is no physics."""

import shutil

from bayes_dea.campaign import load_campaign
from bayes_dea.mismatch.diagnosis import diagnose


def test_a_scale_that_nobody_stated_is_made_up_for_by_no_physics(small_campaign, tmp_path):
    """The bench's displacement is off by 1.5 %, which voltages and presses together would show as a leak."""
    folder = shutil.copytree(small_campaign, tmp_path / "campaign")
    toml = folder / "campaign.toml"
    lines = toml.read_text(encoding="utf-8").splitlines(keepends=True)
    at = lines.index("[sensor.displacement]\n")
    stated = next(i for i in range(at, len(lines)) if lines[i].startswith("accuracy_m"))
    toml.write_text("".join(lines[:stated] + lines[stated + 1 :]), encoding="utf-8")
    summary = diagnose(load_campaign(folder), "hooke+gm3", seed=1).summary
    assert summary["verdict"] == "none"
    (said,) = [w for w in summary["warnings"] if "no accuracy" in w]
    assert "its scale within 10% (sd)" in said
