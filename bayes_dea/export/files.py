"""model.mat, model.npz and model.csv: writing state spaces, and reading them back as python-control objects."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..results import write_atomic
from .state_space import MATRICES, StateSpace
from .systems import Systems

FORMATS = {"matlab": "model.mat", "control": "model.npz", "csv": "model.csv"}


def write_matlab(path: Path, s: Systems) -> None:
    """Structs map and mean, and a 1 x K array of structs draws; sys = ss(m.map.A, m.map.B, m.map.C, m.map.D)."""
    from scipy.io import savemat

    keys = ("input_name", "output_name", "units", "comment", "hold", "model")
    fields = [*MATRICES, "Ts", *keys]

    def of(x: StateSpace) -> dict[str, Any]:
        return {m: getattr(x, m) for m in MATRICES} | {"Ts": x.Ts} | {k: s.about[k] for k in keys}

    draws = np.empty((1, len(s.draws)), dtype=[(f, object) for f in fields])
    for i, x in enumerate(s.draws):
        entry = of(x)
        for f in fields:
            draws[f][0, i] = entry[f]
    content = {"map": of(s.map), "mean": of(s.mean), "draws": draws}
    write_atomic(path, lambda p: savemat(p, content, appendmat=False, do_compression=True, oned_as="column"))


def write_npz(path: Path, s: Systems) -> None:
    """Arrays map_A ... mean_Dd, draws_A (K, m, m) ..., and `about`, a JSON text. No pickles."""
    arrays: dict[str, Any] = {"about": np.array(json.dumps(s.about)), "Ts": np.array(s.map.Ts)}
    for m in MATRICES:
        arrays[f"map_{m}"], arrays[f"mean_{m}"] = getattr(s.map, m), getattr(s.mean, m)
        if s.draws:
            arrays[f"draws_{m}"] = np.stack([getattr(x, m) for x in s.draws])
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    write_atomic(path, lambda p: p.write_bytes(buffer.getvalue()))


def write_csv(path: Path, s: Systems) -> None:
    """One entry a line: system (map, mean, draw), draw (from 1), matrix, row, column (from 1), value, input, output."""
    lines = ["system,draw,matrix,row,column,value,input,output"]
    ends = f"{s.about['input_name']},{s.about['output_name']}"
    every = [("map", 0, s.map), ("mean", 0, s.mean), *(("draw", i, x) for i, x in enumerate(s.draws, start=1))]
    for name, i, x in every:
        lines.append(f"{name},{i},Ts,1,1,{x.Ts!r},{ends}")
        for m in MATRICES:
            for (row, column), value in np.ndenumerate(getattr(x, m)):
                lines.append(f"{name},{i},{m},{row + 1},{column + 1},{float(value)!r},{ends}")
    text = "\n".join(lines) + "\n"
    write_atomic(path, lambda p: p.write_text(text, encoding="utf-8"))


WRITERS: dict[str, Callable[[Path, Systems], None]] = {
    "matlab": write_matlab,
    "control": write_npz,
    "csv": write_csv,
}


@dataclass(frozen=True)
class ControlSystems:
    """python-control state spaces of a calibration, and what they are."""

    map: Any
    mean: Any
    draws: tuple[Any, ...]
    about: dict[str, Any]


def load_state_space(path: str | Path, discrete: bool = False) -> ControlSystems:
    """model.npz (or the folder that holds it) as python-control `StateSpace` objects.

    discrete: the systems of sample time Ts instead of the continuous ones. Raises InputError when python-control is
    not installed, or the file is not one of `bayes-dea export`.
    """
    try:
        import control
    except ImportError as error:
        raise InputError(
            "python-control is not installed: pip install 'bayes-dea[control]' (or pip install control)"
        ) from error
    file = Path(path).expanduser()
    if file.is_dir():
        file = file / FORMATS["control"]
    if not file.is_file():
        raise InputError(f"{file}: there is no such file; write it with `bayes-dea export DIR --to control`")
    try:
        with np.load(file, allow_pickle=False) as arrays:
            content = {k: arrays[k] for k in arrays.files}
        about = json.loads(str(content["about"]))
        step = (float(content["Ts"]),) if discrete else ()
        tail = "d" if discrete else ""

        def of(*parts: np.ndarray) -> Any:
            names = {"inputs": [about["input_name"]], "outputs": [about["output_name"]]}
            return control.ss(*parts, *step, **names)

        one = {w: of(*(content[f"{w}_{m}{tail}"] for m in "ABCD")) for w in ("map", "mean")}
        stacks = [content[f"draws_{m}{tail}"] for m in "ABCD"] if "draws_A" in content else []
        draws = tuple(of(*parts) for parts in zip(*stacks, strict=True)) if stacks else ()
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{file}: is not a whole file of `bayes-dea export DIR --to control` ({error}); write it again"
        ) from error
    return ControlSystems(one["map"], one["mean"], draws, about)
