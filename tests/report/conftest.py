"""A result folder made by hand, stored as a calibration is stored."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import chromium
import numpy as np
import pytest
from layout import Open
from report_samples import (
    CHAINS,
    DRAWS,
    SIGMA_M,
    TRUTH,
    Make,
    creep,
    entry,
    relaxation,
    sine,
    statistics,
)

from bayes_dea.predict_recordings import Prediction
from bayes_dea.store import save_calibration


@pytest.fixture(scope="session")
def make_result() -> Make:
    """Write calibration.json and posterior.nc into a folder: make(folder, recordings, converged=..., **summary)."""

    def make(folder: Path, recordings: list[Prediction] | None = None, converged: bool = True, **changes: Any) -> Path:
        rng = np.random.default_rng(7)
        shape = (CHAINS, DRAWS)
        if recordings is None:
            recordings = [
                creep("creep_1000V.csv", "identify", rng),
                sine("sine_1Hz.csv", "validate", rng),
                relaxation("relaxation.csv", "identify", rng),
            ]
        quantities = {k: c * np.exp(s * rng.standard_normal(shape)) for k, (c, s, *_) in TRUTH.items()}
        quantities["sigma_displacement_m"] = SIGMA_M * np.exp(0.001 * rng.standard_normal(shape))
        quantities["gain_displacement"] = 0.002 + 0.01 * rng.standard_normal(shape)
        prior = {k: c * np.exp(0.8 * rng.standard_normal(1000)) for k, (c, *_) in TRUTH.items()}
        units = {k: u for k, (_, _, u, _) in TRUTH.items()} | {"sigma_displacement_m": "m", "gain_displacement": "1"}
        described = {k: statistics(v, units[k], converged) for k, v in quantities.items()}
        described["gain_displacement"] |= {"map": None, "rhat": None, "ess_bulk": None, "ess_tail": None}
        summary = {
            "model": "hooke+gm1",
            "campaign": "bench day 3",
            "parameters": {k: described[k] for k in TRUTH},
            "noise": {k: described[k] for k in quantities if k not in TRUTH},
            "sampler": {
                "walkers": 32,
                "ensembles": 2,
                "steps": 2700,
                "tau": 41.3 if converged else None,
                "acceptance": 0.23,
                "converged": converged,
                "reason": "converged" if converged else "max_steps reached",
                "burn_in": 450,
                "rhat_max": 1.0021 if converged else 1.73,
                "evaluations": 172_864,
            },
            "search": {"swarms": 8, "agree": 8, "evaluations": 23_292, "converged": True},
            "recordings": [entry(p) for p in recordings],
            "map_log_posterior": 1234.5,
            "log_evidence": 1200.25,
            "log_evidence_se": 0.034,
            "same_function": {
                "form": "generalised Kelvin-Voigt",
                "parameters": {"Y_Pa": 1.26e6, "k_1_Pa": 2.52e7, "tau_1_s": 210.0},
            },
            "priors": {
                k: {"prior": "lognormal(1.2e+06, 0.8)", "unit": u, "source": "a table", "label": label}
                for k, (_, _, u, label) in TRUTH.items()
            },
            "conventions": {"hold": "end", "residuals": "after_offset_and_gain"},
            "seconds": 12.3,
            "seconds_by": {"assemble": 1.5, "map": 4.0, "sample": 6.8},
            "seed": 11,
            "version": "0.1.0",
            "inputs": [{"file": "campaign.toml", "size": 1448, "sha256": "af178aa7c86f7d98" * 4}],
            "meta": {"operator": "N. N."},
            "warnings": ["creep_1000V.csv: 3 drop-outs were masked."],
            **changes,
        }
        calibration = SimpleNamespace(
            draws=rng.standard_normal((*shape, 2)),
            quantities=quantities,
            converged=converged,
            summary=summary,
            posterior=SimpleNamespace(names=("log D", "log T_1"), log_prob=lambda q: -0.5 * np.sum(q**2, axis=1)),
            predictions=tuple(recordings),
            model=SimpleNamespace(name=summary["model"]),
            prior_quantities=prior,
            prior_predictive={
                p.name: np.abs(p.observed).max() * np.exp(0.5 * rng.standard_normal(25)) for p in recordings
            },
        )
        save_calibration(calibration, folder, report=False)  # type: ignore[arg-type]
        return folder

    return make


@pytest.fixture(scope="session")
def result(make_result: Make, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A converged result with its page."""
    from bayes_dea.report.page import write_report

    folder = make_result(tmp_path_factory.mktemp("report") / "converged")
    write_report(folder)
    return folder


@pytest.fixture(scope="session")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Page]:
    """One browser for all tests."""
    found = chromium.find()
    if found is None:
        pytest.skip(f"no browser is installed (looked for {', '.join(chromium.NAMES)})")
    page = chromium.Page(found, tmp_path_factory.mktemp("profile"), 1400)
    yield page
    page.close()


@pytest.fixture
def open_page(tab: chromium.Page) -> Open:
    """Open a file in a window of some width: open_page(path, width, scripts)."""

    def open_page(path: Path, width: int = 1400, scripts: bool = True) -> chromium.Page:
        tab.call("Emulation.setScriptExecutionDisabled", value=not scripts)
        tab.call("Emulation.setEmulatedMedia", media="")
        tab.resize(width, 1000)
        tab.errors.clear()
        tab.requests.clear()
        tab.open(path)
        return tab

    return open_page
