"""What a calibration writes down so that it can be used later without its campaign, and how that is read back.

calibration.json tells numbers for people; to predict or export, the structure has to be built again to the last
digit: exact priors (their transforms and order), the MAP in inference coordinates, the geometry of each specimen,
and how far the recordings went. Both files carry the name of their run, so that a mixture is noticed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .campaign.extent import extent
from .campaign.schema import Actuator, Campaign, Recording
from .errors import InputError
from .models.model import Model, build_model
from .priors import Parameter, Prior

KEY = "reuse"
#: name of a run: a key of calibration.json, an attribute of the group `posterior` of posterior.nc
RUN = "run"


@dataclass(frozen=True)
class Structure:
    """The model of a calibration and where its parts stand among the inference coordinates.

    `own`: positions of the model's parameters that each specimen has for itself. `map`: (d,) inference coordinates.
    """

    model: Model
    coordinates: tuple[str, ...]
    map: NDArray[np.float64]
    specimens: tuple[str, ...]
    own: tuple[int, ...]
    actuators: Mapping[str, Actuator]

    def model_part(self, q: NDArray[np.float64], specimen: str) -> NDArray[np.float64]:
        """Coordinates of the model (B, d_model) of one specimen, out of all coordinates (B, d)."""
        d = self.model.dimension
        x = q[:, :d].copy()
        if self.own and specimen != self.specimens[0]:
            start = d + (self.specimens.index(specimen) - 1) * len(self.own)
            x[:, list(self.own)] = q[:, start : start + len(self.own)]
        return x


def describe(
    model: Model,
    coordinates: Sequence[str],
    at_map: NDArray[np.float64],
    specimens: Sequence[str],
    own: Sequence[int],
    campaign: Campaign,
) -> dict[str, Any]:
    """The entry of calibration.json from which `restore` builds the structure again."""
    actuators = {s: next(r.actuator for r in campaign.recordings if r.specimen == s) for s in specimens}
    return {
        "coordinates": list(coordinates),
        "map": np.asarray(at_map).tolist(),
        "specimens": list(specimens),
        "own": list(own),
        "plain": model.plain,
        "actuators": {s: {k: v for k, v in asdict(a).items() if v is not None} for s, a in actuators.items()},
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "family": p.prior.family,
                "numbers": [p.prior.a, p.prior.b],
                "relative_to": p.prior.relative_to,
                "ordered": p.ordered,
            }
            for p in model.parameters
        ],
    }


def run_of(draws: NDArray[np.float64]) -> str:
    """Name of a run out of its draws (chain, draw, d): the same numbers, the same name."""
    return hashlib.sha256(np.ascontiguousarray(draws, float).tobytes()).hexdigest()[:20]


def check_same_run(summary: Mapping[str, Any], attributes: Mapping[str, Any], posterior: Path) -> None:
    """Raises InputError where posterior.nc, by its attributes, is of another run than calibration.json beside it.

    Files of versions that named no run are taken as they are.
    """
    name = attributes.get(RUN)
    name = name.decode() if isinstance(name, bytes) else name
    if summary.get(RUN) != (None if name is None else str(name)):
        raise InputError(f"{posterior}: is of another run than calibration.json beside it, whose numbers it does not "
                         "hold. Put the file of the same run back, or calibrate again, into a folder of its own")


def seen(recording: Recording) -> dict[str, float]:
    """How far one recording went, for its entry of calibration.json."""
    column = "voltage_V" if recording.is_voltage else "position_m"
    return extent(recording.time_s, recording.columns[column], column)


def restore(summary: Mapping[str, Any], where: str) -> Structure:
    """The structure out of calibration.json; `where` names the file.

    Raises InputError when the entry is missing (a version before it was written) or does not fit together.
    """
    entry = summary.get(KEY)
    if not isinstance(entry, Mapping):
        raise InputError(
            f"{where}: has no '{KEY}' (geometry and exact priors); it was written by an earlier version. Run the "
            "calibration again, with the same command and --seed it gives the same numbers"
        )
    try:
        parameters = tuple(
            Parameter(
                p["name"],
                p["unit"],
                Prior(p["family"], float(p["numbers"][0]), float(p["numbers"][1]), p["relative_to"]),
                ordered=p["ordered"],
            )
            for p in entry["parameters"]
        )
        model = replace(build_model(summary["model"]), parameters=parameters, plain=bool(entry["plain"]))
        known = {f.name for f in fields(Actuator)}
        actuators = {
            s: Actuator(**{k: v for k, v in a.items() if k in known}) for s, a in entry["actuators"].items()
        }
        found = Structure(
            model,
            tuple(entry["coordinates"]),
            np.asarray(entry["map"], float),
            tuple(entry["specimens"]),
            tuple(int(i) for i in entry["own"]),
            actuators,
        )
        fits = (
            found.coordinates[: model.dimension] == model.coordinate_names
            and found.map.shape == (len(found.coordinates),)
            and set(found.specimens) <= set(actuators)
        )
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise InputError(f"{where}: '{KEY}' is damaged ({error!r}); run the calibration again") from error
    if not fits:
        raise InputError(f"{where}: '{KEY}' does not fit the model {summary['model']}; run the calibration again")
    return found
