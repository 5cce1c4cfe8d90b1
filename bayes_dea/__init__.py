"""bayes-dea: Bayesian calibration of dielectric elastomer actuators.

    import bayes_dea as bd
    campaign = bd.load_campaign("quickstart")
    result = bd.calibrate(campaign, "hooke+gm3", seed=1)
    print(result.parameters["Y_Pa"])
    result.save("out")

Names are loaded when they are first used, so that importing the package costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_NAMES = {
    "Actuator": "campaign",
    "Campaign": "campaign",
    "Recording": "campaign",
    "Sensor": "campaign",
    "load_campaign": "campaign",
    "recording_from_arrays": "campaign",
    "campaign_from_recordings": "campaign",
    "Calibration": "calibration",
    "CalibrationSettings": "calibration",
    "calibrate": "calibration",
    "compare": "comparison.run",
    "Comparison": "comparison.run",
    "ComparisonSettings": "comparison.run",
    "diagnose": "mismatch.diagnosis",
    "Diagnosis": "mismatch.diagnosis",
    "DiagnosisSettings": "mismatch.diagnosis",
    "propose": "design.propose",
    "Proposals": "design.propose",
    "ProposalSettings": "design.propose",
    "Model": "models.model",
    "build_model": "models.model",
    "Prior": "priors",
    "Parameter": "priors",
    "read_prior_file": "priors",
    "simulate": "forward",
    "gm_to_gkv": "models.networks",
    "gkv_to_gm": "models.networks",
    "predict": "prediction.answer",
    "command_for": "prediction.command",
    "SignalPrediction": "prediction.result",
    "export_state_space": "export.write",
    "load_state_space": "export.files",
    "run_bench": "bench.run",
    "serve_bench": "bench.device.run",
    "follow_bench": "live.run",
    "LiveSettings": "live.run",
    "import_files": "importing.run",
    "redo_paper": "paper.run",
    "Paper": "paper.run",
    "PaperSettings": "paper.run",
    "write_report": "report.page",
    "load_posterior": "store",
    "inference_data": "store",
    "BayesDEAError": "errors",
    "InputError": "errors",
    "NotConvergedWarning": "errors",
}

__all__ = ["__version__", *sorted(_NAMES)]

if TYPE_CHECKING:
    from .bench.device.run import serve_bench
    from .bench.run import run_bench
    from .calibration import Calibration, CalibrationSettings, calibrate
    from .campaign import (
        Actuator,
        Campaign,
        Recording,
        Sensor,
        campaign_from_recordings,
        load_campaign,
        recording_from_arrays,
    )
    from .comparison.run import Comparison, ComparisonSettings, compare
    from .design.propose import Proposals, ProposalSettings, propose
    from .errors import BayesDEAError, InputError, NotConvergedWarning
    from .export.files import load_state_space
    from .export.write import export_state_space
    from .forward import simulate
    from .importing.run import import_files
    from .live.run import LiveSettings, follow_bench
    from .mismatch.diagnosis import Diagnosis, DiagnosisSettings, diagnose
    from .models.model import Model, build_model
    from .models.networks import gkv_to_gm, gm_to_gkv
    from .paper.run import Paper, PaperSettings, redo_paper
    from .prediction.answer import predict
    from .prediction.command import command_for
    from .prediction.result import SignalPrediction
    from .priors import Parameter, Prior, read_prior_file
    from .report.page import write_report
    from .store import inference_data, load_posterior


def __getattr__(name: str) -> Any:
    if name not in _NAMES:
        raise AttributeError(f"module 'bayes_dea' has no attribute '{name}'")
    value = getattr(importlib.import_module(f".{_NAMES[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
