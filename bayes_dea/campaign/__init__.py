"""Reading and checking campaigns (CONTRACT 1).

`load_campaign` reads folders; `recording_from_arrays` and `campaign_from_recordings` do the same from arrays.
"""

from bayes_dea.campaign.build import campaign_from_recordings, recording_from_arrays
from bayes_dea.campaign.read import load_campaign
from bayes_dea.campaign.require import require_geometry, require_sensor
from bayes_dea.campaign.schema import (
    HOLDS,
    KINDS,
    MECHANICAL_KINDS,
    OTHER_KINDS,
    ROLES,
    VOLTAGE_KINDS,
    Actuator,
    Campaign,
    Recording,
    Sensor,
)

__all__ = ["HOLDS", "KINDS", "MECHANICAL_KINDS", "OTHER_KINDS", "ROLES", "VOLTAGE_KINDS", "Actuator",
           "Campaign", "Recording", "Sensor", "campaign_from_recordings", "load_campaign",
           "recording_from_arrays", "require_geometry", "require_sensor"]
