"""A campaign that is calibrated in a second."""

import re
import shutil
from pathlib import Path


def tiny_campaign(small: Path, folder: Path) -> Path:
    """Two recordings of the preset `small`, four seconds each: one to fit and one to predict."""
    shutil.copytree(small, folder)
    toml = folder / "campaign.toml"
    parts = re.split(r"(?=\[\[recording\]\])|(?=\[meta\])", toml.read_text(encoding="utf-8"))
    kept = [p for p in parts if not p.startswith("[[") or "sine_1Hz" in p or "rectangle_1Hz" in p]
    toml.write_text("".join(kept), encoding="utf-8")
    return folder
