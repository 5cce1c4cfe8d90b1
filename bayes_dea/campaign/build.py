"""Campaigns from arrays, with the same checks as from files (for notebooks, tests and the reader itself)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.campaign.checks import check_columns
from bayes_dea.campaign.dead_sensors import check_dead_sensors
from bayes_dea.campaign.gaps import gap_warnings
from bayes_dea.campaign.holes import hole_warnings
from bayes_dea.campaign.plausibility import OVERRIDE, check_plausible
from bayes_dea.campaign.schema import HOLDS, ROLES, Actuator, Campaign, Recording, Sensor
from bayes_dea.campaign.settings import check_geometry, choice, parse_conventions
from bayes_dea.campaign.specimens import check_specimens
from bayes_dea.campaign.statements import check_statements
from bayes_dea.campaign.stiffness import check_stiffness
from bayes_dea.campaign.time_units import check_named_frequencies, check_time_units
from bayes_dea.campaign.uneven import uneven_warnings
from bayes_dea.campaign.unused import unused_warnings
from bayes_dea.campaign.vocabulary import COLUMNS
from bayes_dea.errors import InputError

#: warning of a campaign with nothing to check predictions on
NO_VALIDATION = (
    'No recording has role = "validate": predictions cannot be checked on recordings that no fit has seen. Set aside '
    "one or two."
)


def recording_from_arrays(name: str, kind: str, columns: Mapping[str, ArrayLike], role: str = "identify",
                          actuator: Actuator | None = None, *, specimen: str = "A", hold: str = "end",
                          zeroed: bool = False, rested: bool = True, rest_before_s: float | None = None,
                          path: Path | str | None = None,
                          where: Callable[[int], str] | None = None) -> Recording:
    """A checked recording from arrays of shape (n,) in SI units, copied to read-only float64.

    `columns` holds what the kind needs (`time_s, voltage_V, displacement_m`, ...) by name; nan is a gap.
    Further columns are kept. `where(i)` says where element i stands, for messages. Raises InputError for
    everything that cannot be a recording; units are judged when the campaign is put together.
    """
    choice(role, ROLES, f"{name}: role")
    choice(hold, HOLDS, f"{name}: hold")
    if rest_before_s is not None and rested:
        raise InputError(f"{name}: rest_before_s goes with rested = false.")
    if not columns:
        raise InputError(f"{name}: there are no columns.")
    actuator = actuator or Actuator()
    check_geometry(actuator, f"{name}, actuator")
    known = COLUMNS[kind].required if kind in COLUMNS else ()
    ordered = [c for c in known if c in columns] + [c for c in columns if c not in known]
    frozen = {c: _freeze(columns[c], f"{name}, column {c}") for c in ordered}
    check_columns(name, kind, frozen, where or (lambda i: f"row {i + 1}"))
    return Recording(name=name, path=Path(path) if path is not None else Path(name), kind=kind, role=role,
                     columns=MappingProxyType(frozen), actuator=actuator, specimen=specimen, hold=hold,
                     zeroed=zeroed, rested=rested, rest_before_s=rest_before_s)


def _freeze(values: ArrayLike, what: str) -> NDArray[np.float64]:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as exc:
        raise InputError(f"{what}: is not made of numbers ({exc}).") from exc
    if array.ndim != 1:
        raise InputError(f"{what}: must be one-dimensional, not of shape {array.shape}.")
    if array.flags.writeable:
        if array.base is not None or array is values:
            array = array.copy()  # the caller may go on writing to it
        array.flags.writeable = False
    return array


def campaign_from_recordings(recordings: Iterable[Recording], sensors: Mapping[str, Sensor] | None = None,
                             actuator: Actuator | None = None, *, name: str = "campaign",
                             folders: Sequence[Path] = (), ambient: Mapping[str, float] | None = None,
                             share: Sequence[str] | None = None, meta: Mapping[str, Any] | None = None,
                             conventions: Mapping[str, str] | None = None,
                             inputs: Sequence[Mapping[str, Any]] = (), warnings: Sequence[str] = (),
                             where: Sequence[Callable[[int], str]] | None = None) -> Campaign:
    """A checked campaign from recordings.

    `actuator` is that of the first recording where nothing is said; `conventions` are completed with the
    defaults. `where` says for every recording where its elements stand. Raises InputError for a campaign
    without recordings, names or numbers that are there twice, units and statements off by a power of ten, a
    sensor of the wrong sign, and recordings that cannot be of one specimen.
    """
    found = tuple(recordings)
    if not found:
        raise InputError(f"{name}: there is no recording in the campaign.")
    used = parse_conventions(conventions or {}, name)
    _refuse_duplicates(found)
    collected = list(warnings)
    places = list(where) if where is not None else [_row] * len(found)
    for i, recording in enumerate(found):
        collected += check_plausible(recording, sensors, places[i], strict=used["plausibility"] == "error")
        earlier = [r for r in found[:i] if r.specimen == recording.specimen
                   and (r.is_voltage or not recording.is_voltage)]
        if not recording.rested and not earlier:
            raise InputError(f"{recording.name}: rested = false, but no recording of specimen "
                             f"{recording.specimen} stands above it whose memory it could carry. Put that "
                             "one above, or take rested out.")
    together = check_statements(found, sensors or {}) + check_specimens(found, sensors or {})
    together += check_dead_sensors(found) + check_stiffness(found, sensors or {})
    if together and used["plausibility"] == "error":
        raise InputError(f"{together[0]} {OVERRIDE}")
    collected += together + check_time_units(found) + check_named_frequencies(found)
    collected += uneven_warnings(found) + hole_warnings(found, places) + gap_warnings(found, places)
    collected += unused_warnings(found, sensors or {})
    if used["memory"] == "continued":
        collected += _not_continued(found)
    else:
        collected += _rest_unsaid(found)
    if not any(r.role == "validate" for r in found) and len(found) > 1:
        collected.append(NO_VALIDATION)
    return Campaign(
        name=name, folders=tuple(folders), actuator=actuator or found[0].actuator,
        sensors=MappingProxyType(dict(sensors or {})), recordings=found,
        ambient=MappingProxyType(dict(ambient or {})), share=None if share is None else tuple(share),
        meta=MappingProxyType(dict(meta or {})), conventions=MappingProxyType(used), inputs=tuple(inputs),
        warnings=tuple(dict.fromkeys(collected)))


def _rest_unsaid(recordings: Sequence[Recording]) -> list[str]:
    """A line on recordings that carry the memory of the one above over a rest of unknown length; none without any."""
    names = [r.name for r in recordings if not r.rested and r.rest_before_s is None]
    if not names:
        return []
    return [f"{', '.join(names)}: rested = false without rest_before_s is taken as no rest at all since the recording "
            "above ended. Where there was one, say how long (rest_before_s, in s): what was relaxed meanwhile passes "
            "for missing physics otherwise."]


def _not_continued(recordings: Sequence[Recording]) -> list[str]:
    """A line on mechanical recordings that memory = "continued" says nothing to; none without any."""
    names = [r.name for r in recordings if r.is_mechanical and r.rested]
    if not names:
        return []
    begin = "begins" if len(names) == 1 else "begin"
    return [f'memory = "continued" concerns voltage recordings: {", ".join(names)} {begin} rested, because nobody '
            "recorded what the specimen did out of contact before. If it had not rested, join the mechanical "
            "recordings into one file."]


def _row(k: int) -> str:
    return f"row {k + 1}"


def _refuse_duplicates(recordings: Sequence[Recording]) -> None:
    names: set[str] = set()
    for i, r in enumerate(recordings):
        if r.name in names:
            raise InputError(f'Two recordings are called "{r.name}". Take one out, or give it another name = '
                             '"...".')
        names.add(r.name)
        for other in recordings[:i]:
            if _same(r, other):
                raise InputError(f'"{r.name}" and "{other.name}" hold the same numbers; a recording counted '
                                 'twice makes the answer look surer than it is. Take one out.')


def _same(a: Recording, b: Recording) -> bool:
    if a.n != b.n or a.columns.keys() != b.columns.keys():
        return False
    # the observed column decides; a look at a few elements spares comparing millions
    probe = np.linspace(0, a.n - 1, min(a.n, 50)).astype(int)
    x, y = a.columns[a.output], b.columns[a.output]
    if not np.array_equal(x[probe], y[probe], equal_nan=True) or np.nanmin(x) == np.nanmax(x):
        return False
    return all(np.array_equal(a.columns[c], b.columns[c], equal_nan=True) for c in a.columns)
