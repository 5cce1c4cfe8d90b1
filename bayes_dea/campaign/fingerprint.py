"""What a campaign says, as one number: results that are kept belong to these very recordings."""

from __future__ import annotations

import hashlib
from dataclasses import fields

from .schema import Campaign
from .scratch import pieces


def fingerprint(campaign: Campaign) -> str:
    """SHA-256 of everything that a fit depends on: columns, actuators, sensors and statements, not names of folders.

    Campaigns that were made or changed in memory have no files whose hashes would tell them apart.
    """
    out = hashlib.sha256()

    def add(*values: object) -> None:
        out.update(repr(values).encode())

    add(sorted(campaign.sensors.items()), sorted(campaign.ambient.items()), campaign.share,
        sorted(campaign.conventions.items()))
    for r in campaign.recordings:
        add([(f.name, getattr(r, f.name)) for f in fields(r) if f.name not in ("path", "columns")])
        for name, values in sorted(r.columns.items()):
            add(name, values.dtype.str, values.size)
            for part in pieces(values.size):
                out.update(values[part].tobytes())
    return out.hexdigest()
