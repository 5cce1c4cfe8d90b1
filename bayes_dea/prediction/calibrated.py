"""A finished calibration, from its folder or from memory, as what predicting and exporting need of it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Actuator
from ..errors import InputError
from ..results import plain, read_json, unreadable
from ..reuse import KEY, Structure, check_same_run, restore
from ..store import CALIBRATION_FILE, POSTERIOR_FILE

if TYPE_CHECKING:
    from ..calibration import Calibration

_DAMAGED = "it was cut off or damaged. Calibrate again"


@dataclass(frozen=True)
class Calibrated:
    """A calibration to be used. `summary` is calibration.json; `draws` (n, d) are inference coordinates;
    `quantities` are reported draws (n,) by name, of the same rows."""

    where: str
    summary: Mapping[str, Any] = field(repr=False)
    structure: Structure = field(repr=False)
    draws: NDArray[np.float64] = field(repr=False)
    quantities: Mapping[str, NDArray[np.float64]] = field(repr=False)
    inputs: tuple[Mapping[str, Any], ...] = ()

    def specimen(self, name: str | None) -> str:
        """The specimen of that name, by default the first one. Raises InputError for one that was not calibrated."""
        known = self.structure.specimens
        if name is None:
            return known[0]
        if name not in known:
            raise InputError(f"--specimen {name}: {self.where} calibrated {', '.join(known)}; take one of these")
        return name

    def taken(self, name: str | None) -> list[str]:
        """What to say where one of several specimens is taken because none was named."""
        known = self.structure.specimens
        if name is not None or len(known) < 2:
            return []
        return [f"{self.where} calibrated the specimens {', '.join(known)}; this is the answer of "
                f"{known[0]}. --specimen names another one."]

    def actuator(self, specimen: str) -> Actuator:
        """Geometry and limits of a specimen."""
        return self.structure.actuators[specimen]

    def rows(self, count: int, at_most: bool = False) -> NDArray[np.int64]:
        """Rows of `count` draws, spread evenly; `at_most`: of all where there are fewer.

        Raises InputError for none, or more than there are.
        """
        n = len(self.draws)
        if at_most:
            count = min(count, n)
        if count < 1 or count > n:
            raise InputError(f"{count} draws were asked for; {self.where} holds {n}: take 1 to {n}")
        return np.unique(np.linspace(0, n - 1, count).round().astype(np.int64))

    def coordinates(self, specimen: str, rows: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
        """Coordinates of the model (B, d_model) of some draws, by default of the MAP (1, d_model)."""
        q = self.structure.map[None] if rows is None else self.draws[rows]
        return self.structure.model_part(q, specimen)

    @property
    def converged(self) -> bool:
        """Whether the calibration's sampler had converged."""
        return bool(self.summary.get("sampler", {}).get("converged"))

    def recordings(self, specimen: str, channel: str) -> list[Mapping[str, Any]]:
        """Entries of the recordings that were fitted, of one channel; of this specimen where it has any."""
        of_channel = [
            r for r in self.summary["recordings"] if r.get("channel") == channel and r.get("role") == "identify"
        ]
        return [r for r in of_channel if r.get("specimen", "A") == specimen] or of_channel


def open_calibration(source: Path | str | Calibration | Calibrated) -> Calibrated:
    """A calibration from its folder, or as `calibrate` returned it.

    Raises InputError when the folder is not the --out of a calibration, a file is cut off, or the two files come
    from different runs.
    """
    if isinstance(source, Calibrated):
        return source
    if not isinstance(source, (str, Path)):
        summary = plain(source.summary)
        where = f"the calibration of {summary['model']}"
        flat = source.draws.reshape(-1, source.draws.shape[-1])
        return Calibrated(
            where,
            summary,
            restore(summary, where),
            flat,
            {k: np.asarray(v).ravel() for k, v in source.quantities.items()},
        )
    folder = Path(source).expanduser()
    summary = _summary(folder)
    structure = restore(summary, str(folder / CALIBRATION_FILE))
    draws, quantities, attributes = _posterior(folder, structure)
    check_same_run(summary, attributes, folder / POSTERIOR_FILE)
    inputs = tuple(_input(folder / name) for name in (CALIBRATION_FILE, POSTERIOR_FILE))
    return Calibrated(str(folder), summary, structure, draws, quantities, inputs)


def _input(path: Path) -> dict[str, Any]:
    with path.open("rb") as handle:
        digest = hashlib.file_digest(handle, "sha256").hexdigest()
    return {"file": path.name, "size": path.stat().st_size, "sha256": digest}


def _summary(folder: Path) -> dict[str, Any]:
    path = folder / CALIBRATION_FILE
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        raise InputError(f"{folder}: {what}; give the folder that `bayes-dea calibrate ... --out DIR` wrote")
    if not path.is_file():
        raise InputError(
            f"{folder}: holds no {CALIBRATION_FILE}; give the folder that `bayes-dea calibrate ... --out DIR` wrote"
        )
    try:
        summary = read_json(path)
    except (OSError, ValueError) as error:
        raise unreadable(path, error, "read", _DAMAGED) from error
    missing = [k for k in ("model", "parameters", "noise", "recordings", "sampler") if k not in summary]
    if missing:
        raise InputError(f"{path}: has no {', '.join(missing)}; it is not the result of a calibration")
    return summary


def _posterior(
    folder: Path, structure: Structure
) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]], dict[str, Any]]:
    """Coordinates (n, d) and reported quantities (n,) of all draws, and what is said of them."""
    import h5py

    path = folder / POSTERIOR_FILE
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; is {folder} the --out of a calibration?")
    try:
        # plain HDF5 inside; reading it as such spares the seconds that importing arviz takes
        with h5py.File(path, "r") as file:
            group = file["posterior"]
            attributes = dict(group.attrs)
            coordinates = np.asarray(group["coordinates"][()], float)
            names = tuple(n.decode() if isinstance(n, bytes) else str(n) for n in group["coordinate"][()])
            quantities = {
                key: np.asarray(item[()], float).ravel()
                for key, item in group.items()
                if hasattr(item, "shape") and item.shape == coordinates.shape[:2]
            }
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        raise unreadable(path, error, "read as a posterior", _DAMAGED) from error
    if names != structure.coordinates or coordinates.ndim != 3 or coordinates.shape[2] != len(names):
        raise InputError(
            f"{path}: belongs to another run than {CALIBRATION_FILE} beside it. Calibrate again, into a folder of "
            "its own"
        )
    return coordinates.reshape(-1, len(names)), quantities, attributes


__all__ = ["KEY", "Calibrated", "open_calibration"]
