"""How a command line names a campaign that was read."""

from __future__ import annotations

from pathlib import Path

from bayes_dea.campaign.schema import Campaign

_PLACEHOLDER, _USUAL = "CAMPAIGN", "campaign.toml"


def campaign_words(campaign: Campaign) -> list[str]:
    """Its folders, or files where these are not called campaign.toml; a placeholder for one that lies nowhere."""
    words = []
    for folder, entry in zip(campaign.folders, campaign.inputs, strict=False):  # campaign.toml files come first
        name = Path(entry["file"]).name  # of several folders each name has its folder's before it
        words.append(str(folder if name == _USUAL else folder / name))
    return words or [_PLACEHOLDER]
