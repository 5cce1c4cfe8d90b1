"""What the page is made from: calibration.json and posterior.nc of a result folder, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from ..errors import InputError
from ..page_data import PageData
from ..results import read_json, unreadable
from ..reuse import check_same_run
from ..store import CALIBRATION_FILE, POSTERIOR_FILE, variable_names
from . import symbols

Array = NDArray[np.float64]
_BLOCK_KEYS = ("time_s", "input", "count", "mean", "sd_parameters", "sd_sample", "sd_block")
#: unit of a channel, and the column that drives it where calibration.json does not say
CHANNELS = {"displacement": ("m", "voltage_V"), "force": ("N", "position_m"), "capacitance": ("F", "displacement_m")}
_COLUMN_WORDS = {
    "displacement": "displacement",
    "force": "force",
    "voltage": "voltage",
    "position": "position",
    "capacitance": "capacitance",
}


@dataclass(frozen=True)
class RecordingData:
    """One recording: its entry of calibration.json and its blocks; arrays (nb,) unless said."""

    entry: Mapping[str, Any]
    observed: Array = field(repr=False)
    time_s: Array = field(repr=False)
    input: Array = field(repr=False)
    mean: Array = field(repr=False)
    sd_sample: Array = field(repr=False)  # of one sample, noise included
    sd_block: Array = field(repr=False)  # of the mean of the block
    by_time: Mapping[str, Array] = field(repr=False)  # edges (b + 1,), mean, rms, mean_se (b,) in units of noise sd
    by_input: Mapping[str, Array] = field(repr=False)
    spectrum: Mapping[str, Array] = field(repr=False)  # frequency_Hz, density (f,), white (1,)
    pit_histogram: Array = field(repr=False)
    prior_largest: Array = field(repr=False)  # largest output of prior draws, may be empty
    page: PageData | None = field(repr=False, default=None)  # for zooming; results of older versions have none

    @property
    def name(self) -> str:
        """As in the campaign."""
        return str(self.entry["recording"])

    @property
    def fitted(self) -> bool:
        """False for a recording that was only predicted."""
        return self.entry.get("role") == "identify"

    @property
    def channel(self) -> str:
        """What was observed."""
        return str(self.entry.get("channel", "displacement"))

    @property
    def unit(self) -> str:
        """SI unit of the observed channel."""
        return rmse_of(self.entry)[1]

    @property
    def input_column(self) -> tuple[str, str]:
        """Name and SI unit of what drives it."""
        column = str(self.entry.get("input") or CHANNELS.get(self.channel, ("1", "voltage_V"))[1])
        word, _, unit = column.rpartition("_")
        return _COLUMN_WORDS.get(word, word or column), unit


@dataclass(frozen=True)
class ResultData:
    """A calibration's results. `posterior` holds (chain, draw) arrays by reported name, `prior` (n,)."""

    summary: Mapping[str, Any]
    posterior: Mapping[str, Array] = field(repr=False)
    prior: Mapping[str, Array] = field(repr=False)
    lp: Array = field(repr=False)
    recordings: tuple[RecordingData, ...] = field(repr=False)

    @property
    def converged(self) -> bool:
        """Whether the sampler's stopping rule was met."""
        return bool(self.summary["sampler"].get("converged"))

    def unit(self, name: str) -> str:
        """Unit of a reported quantity."""
        return str(self.entry(name).get("unit", "1"))

    def entry(self, name: str) -> Mapping[str, Any]:
        """Summary of a reported quantity, material or noise; empty when there is none."""
        found: Mapping[str, Any] = self.summary["parameters"].get(name) or self.summary["noise"].get(name) or {}
        return found

    def described(self, name: str) -> Mapping[str, Any]:
        """Prior, unit, source and label of a parameter, of a specimen's own too; empty where there is none."""
        priors = self.summary.get("priors") or {}
        return priors.get(specimen_of(name, priors)[0]) or {}

    def prior_of(self, name: str) -> Array | None:
        """Prior draws (n,) of a quantity, None where none were stored."""
        return self.prior.get(specimen_of(name, self.prior)[0])

    def plain(self, name: str) -> str:
        """Symbol of a quantity for a picture."""
        base, specimen = specimen_of(name, self.summary.get("priors") or {})
        text = symbols.plain(base, self.described(name).get("label"))
        return f"{text} ({specimen})" if specimen else text

    def html(self, name: str) -> Markup:
        """Symbol of a quantity for the page."""
        base, specimen = specimen_of(name, self.summary.get("priors") or {})
        text = symbols.html(base, self.described(name).get("label"))
        return text + Markup(" ({})").format(specimen) if specimen else text


def rmse_of(entry: Mapping[str, Any]) -> tuple[float | None, str]:
    """RMSE of a recording's entry and its unit (``rmse_m``, ``rmse_N``, ...); None with the channel's unit if null."""
    for key, value in entry.items():
        if key.startswith("rmse_") and key != "rmse_raw" and value is not None:
            return value, key[len("rmse_") :]
    return None, CHANNELS.get(str(entry.get("channel")), ("1", ""))[0]


def specimen_of(name: str, known: Mapping[str, Any]) -> tuple[str, str]:
    """Name of a parameter as the model has it, and the specimen whose own it is: ``Y_Pa_B`` is Y_Pa of B."""
    # a specimen may be called "no_2"
    bases = [] if name in known else [base for base in known if name.startswith(f"{base}_")]
    base = max(bases, key=len, default=name)
    return base, name[len(base) + 1 :]


def read_summary(folder: Path) -> dict[str, Any]:
    """calibration.json of a folder. Raises InputError naming the file when it is missing or not one of ours."""
    path = folder / CALIBRATION_FILE
    try:
        summary = read_json(path)
    except FileNotFoundError as error:
        raise InputError(f"{path}: there is no such file; is {folder} the --out of a calibration?") from error
    except (OSError, ValueError) as error:
        raise unreadable(path, error, "read", "run the calibration again") from error
    missing = [k for k in ("model", "parameters", "noise", "sampler", "recordings") if k not in summary]
    if missing:
        raise InputError(f"{path}: has no {', '.join(missing)}; it is not the result of a calibration. Run it again")
    return summary


def read_result(folder: Path) -> ResultData:
    """Everything the page shows. Raises InputError for files that are missing, broken or of two different runs."""
    import h5py

    summary = read_summary(folder)
    path = folder / POSTERIOR_FILE
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; is {folder} the --out of a calibration?")
    try:
        # plain HDF5 inside; reading it as such spares the seconds that importing arviz takes
        with h5py.File(path, "r") as file:
            posterior = _group(file, "posterior")
            if "posterior" in file:
                check_same_run(summary, file["posterior"].attrs, path)
            shape = _chain_shape(posterior)
            draws = {k: v for k, v in posterior.items() if v.shape == shape}
            prior = {k: v.ravel() for k, v in _group(file, "prior").items() if v.ndim == 2}
            lp = _group(file, "sample_stats").get("lp", np.empty(shape))
            recordings = _recordings(
                summary,
                _group(file, "observed_data"),
                _group(file, "constant_data"),
                _group(file, "prior_predictive"),
                _pages(file),
            )
    except (OSError, ValueError) as error:
        raise unreadable(path, error, "read as a posterior", "run the calibration again") from error
    except KeyError as error:
        raise InputError(
            f"{path}: has no {error.args[0]}, which {CALIBRATION_FILE} beside it speaks of: the two come "
            "from different runs. Run the calibration again"
        ) from error
    absent = [name for name in summary["parameters"] if name not in draws]
    if absent:
        raise InputError(
            f"{path}: has no draws of {', '.join(absent)}, which {CALIBRATION_FILE} beside it speaks of: "
            "the two come from different runs. Run the calibration again"
        )
    return ResultData(summary, draws, prior, lp, recordings)


def _group(file: Any, name: str) -> dict[str, Array]:
    if name not in file:
        return {}
    return {
        key: np.asarray(item[()], dtype=float)
        for key, item in file[name].items()
        if hasattr(item, "dtype") and item.dtype.kind in "fiu" and not key.endswith("__page")
    }


def _pages(file: Any) -> dict[str, PageData]:
    """What was kept of each recording for zooming, by its name as a variable."""
    group = file.get("constant_data", {})
    return {
        key.removesuffix("__page"): PageData.from_bytes(np.asarray(item[()], dtype=np.uint8).tobytes())
        for key, item in group.items()
        if key.endswith("__page") and hasattr(item, "dtype")
    }


def _chain_shape(posterior: Mapping[str, Array]) -> tuple[int, ...]:
    return next((v.shape for k, v in posterior.items() if v.ndim == 2), (0, 0))


def _recordings(
    summary: Mapping[str, Any],
    observed: Mapping[str, Array],
    constant: Mapping[str, Array],
    largest: Mapping[str, Array],
    pages: Mapping[str, PageData],
) -> tuple[RecordingData, ...]:
    entries = summary["recordings"]
    names = variable_names([e["recording"] for e in entries])
    out = []
    for entry in entries:
        v = names[entry["recording"]]
        blocks = {key: constant[f"{v}__{key}"] for key in _BLOCK_KEYS}
        tables = {
            group: {
                key[len(f"{v}__{group}__") :]: value
                for key, value in constant.items()
                if key.startswith(f"{v}__{group}__")
            }
            for group in ("time", "input", "spectrum")
        }
        peaks = largest.get(f"{v}_largest", np.empty(0)).ravel()
        out.append(
            RecordingData(
                entry,
                observed[v],
                blocks["time_s"],
                blocks["input"],
                blocks["mean"],
                blocks["sd_sample"],
                blocks["sd_block"],
                tables["time"],
                tables["input"],
                tables["spectrum"],
                constant.get(f"{v}__pit_histogram", np.empty(0)),
                peaks[np.isfinite(peaks)],
                pages.get(v),
            )
        )
    return tuple(out)
