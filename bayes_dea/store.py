"""posterior.nc: everything that was drawn, as ArviZ InferenceData, and the folder of a calibration's results.

Groups: `posterior` (reported quantities (chain, draw), and the inference coordinates), `sample_stats` (lp),
`log_likelihood` (`identify` and `validate`, (chain, draw, recording): offsets integrated out, gain conditional on the
draw), `posterior_predictive` and `observed_data` (one variable a recording, block means), `constant_data` (time, input,
counts and bands of the same blocks; `..__page`, bytes: samples near edges and short bins, see `page_data`), `prior`,
`prior_predictive`. A chain is an ensemble.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import InputError
from .fit.diagnostics import arviz
from .results import json_bytes, unreadable, write_all_bytes
from .reuse import RUN

if TYPE_CHECKING:
    from .calibration import Calibration

CALIBRATION_FILE = "calibration.json"
POSTERIOR_FILE = "posterior.nc"
REPORT_FILE = "report.html"

#: called with (done, of, text)
Report = Callable[[float, float, str], None]


def variable_name(recording: str) -> str:
    """Name of a recording as a variable: letters, digits and underscores."""
    stem = recording.rsplit(".", 1)[0] if "." in recording else recording
    return "".join(ch if ch.isalnum() else "_" for ch in stem)


def variable_names(recordings: list[str]) -> dict[str, str]:
    """A variable name for each recording, all different."""
    out: dict[str, str] = {}
    for name in recordings:
        base, i = variable_name(name), 2
        candidate = base
        while candidate in out.values():
            candidate = f"{base}_{i}"
            i += 1
        out[name] = candidate
    return out


def inference_data(calibration: Calibration) -> Any:
    """ArviZ InferenceData of a calibration."""
    import xarray as xr

    az = arviz()
    chains, draws = calibration.draws.shape[:2]
    coordinates = {"chain": np.arange(chains), "draw": np.arange(draws)}
    posterior = xr.Dataset(
        {name: (("chain", "draw"), v) for name, v in calibration.quantities.items()}
        | {"coordinates": (("chain", "draw", "coordinate"), calibration.draws)},
        coords=coordinates | {"coordinate": list(calibration.posterior.names)},
    )
    lp = calibration.posterior.log_prob(calibration.draws.reshape(chains * draws, -1)).reshape(chains, draws)
    stats = xr.Dataset({"lp": (("chain", "draw"), lp)}, coords=coordinates)
    loglik = {}
    for role in ("identify", "validate"):
        members = [p for p in calibration.predictions if p.role == role]
        if members:
            dim = f"recording_{role}"
            loglik[role] = xr.DataArray(
                np.stack([p.log_likelihood for p in members], axis=-1).reshape(chains, draws, len(members)),
                dims=("chain", "draw", dim),
                coords=coordinates | {dim: [p.name for p in members]},
            )
    names = variable_names([p.name for p in calibration.predictions])
    predictive, observed, constant = {}, {}, {}
    for p in calibration.predictions:
        v = names[p.name]
        block = f"block_{v}"
        predictive[v] = (("chain", "draw", block), p.draws[None].astype(np.float32))
        observed[v] = ((block,), p.observed)
        for key in ("time_s", "input", "count", "mean", "sd_parameters", "sd_sample", "sd_block"):
            constant[f"{v}__{key}"] = ((block,), getattr(p, key))
        for group, table in (("time", p.by_time), ("input", p.by_input), ("spectrum", p.spectrum)):
            for key, values in table.items():
                constant[f"{v}__{group}__{key}"] = ((f"{v}_{group}_{key}",), np.asarray(values, float))
        constant[f"{v}__pit_histogram"] = (("pit_bin",), np.asarray(p.histogram))
        if p.page is not None:
            constant[f"{v}__page"] = ((f"{v}_page_byte",), np.frombuffer(p.page.to_bytes(), np.uint8))
    prior = xr.Dataset(
        {name: (("chain", "draw"), np.asarray(v)[None]) for name, v in calibration.prior_quantities.items()}
    )
    prior_predictive = xr.Dataset(
        {f"{names[k]}_largest": (("chain", "draw"), v[None]) for k, v in calibration.prior_predictive.items()}
    )
    attributes = {
        "model": calibration.model.name,
        "seed": calibration.summary["seed"],
        "version": calibration.summary["version"],
        "converged": int(calibration.converged),
        **{k: v for k, v in calibration.summary.items() if k == RUN},
    }
    data = az.InferenceData(
        posterior=posterior.assign_attrs(attributes),
        sample_stats=stats,
        log_likelihood=xr.Dataset(loglik),
        posterior_predictive=xr.Dataset(predictive),
        observed_data=xr.Dataset(observed),
        constant_data=xr.Dataset(constant),
        prior=prior,
        prior_predictive=prior_predictive,
    )
    return data


def netcdf_bytes(data: Any, report: Report | None = None) -> bytes:
    """InferenceData as the content of a netCDF file. report: called with (bytes done, of how many, group).

    Made in memory: where the disk is full, HDF5 goes on failing as it closes its file and takes the process along.
    """
    import h5netcdf
    from xarray.backends.h5netcdf_ import H5NetCDFStore

    buffer = io.BytesIO()
    done, whole = 0, max(sum(dataset.nbytes for _, dataset in data.items()), 1)
    with h5netcdf.File(buffer, "w") as file:
        for name, dataset in data.items():
            numbers = [v for v, values in dataset.variables.items() if values.dtype.kind in "iufb"]
            dataset.dump_to_store(H5NetCDFStore(file.create_group(name)), encoding={v: {"zlib": True} for v in numbers})
            done += dataset.nbytes
            if report is not None:
                report(done, whole, name)
    return buffer.getvalue()


def save_calibration(calibration: Calibration, out: Path, report: bool = True, tell: Report | None = None) -> Path:
    """Write posterior.nc, calibration.json and report.html; JSON comes after what it describes.

    Both are made in memory first, so that what fails in making them leaves the results of an earlier run together.
    tell: called with (bytes done, of how many, group) as the posterior is written.
    """
    data = inference_data(calibration)
    summary = json_bytes(calibration.summary)
    write_all_bytes({out / POSTERIOR_FILE: netcdf_bytes(data, tell), out / CALIBRATION_FILE: summary})
    if report:
        from .report.page import write_report

        write_report(out)
    return out


def load_posterior(folder: str | Path) -> Any:
    """InferenceData of a result folder. Raises InputError when it is not there or not readable."""
    path = Path(folder) / POSTERIOR_FILE
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; is {folder} the --out of a calibration?")
    try:
        return arviz().from_netcdf(str(path), engine="h5netcdf")
    except (OSError, ValueError) as error:
        raise unreadable(path, error, "read as a posterior", "run the calibration again") from error
