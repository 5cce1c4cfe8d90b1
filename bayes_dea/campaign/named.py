"""How a command line names a campaign that was read."""

from __future__ import annotations

from bayes_dea.campaign.schema import Campaign

_PLACEHOLDER, _USUAL = "CAMPAIGN", "campaign.toml"


def campaign_words(campaign: Campaign) -> list[str]:
    """Its folders, or files where these are not called campaign.toml; a placeholder for one that lies nowhere."""
    words = []
    for folder, entry in zip(campaign.folders, campaign.inputs, strict=False):  # campaign.toml files come first
        words.append(str(folder if entry["file"] == _USUAL else folder / entry["file"]))
    return words or [_PLACEHOLDER]
