"""What is known of one model once it is done, as a file: a killed comparison goes on with the next model."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..assemble import Assembled
from ..fit.mixture import Mixture
from ..models.model import Model
from ..results import write_bytes
from .fit_one import Fitted, reference_at
from .integrate import Integral
from .leave_out import LeftOut

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Done:
    """One model: its maximum, its integral, its scores, how long it took.

    spared: it fits so much worse than another one that no effort was spent on an integral that is hard to find.
    """

    fit: Fitted
    whole: Integral
    scores: tuple[LeftOut, ...]
    rmse_m: float | None
    seconds: dict[str, float] = field(default_factory=dict)
    spared: bool = False


def keep(path: Path, done: Done) -> None:
    """Write what `recall` needs, whole or not at all."""
    f, w = done.fit, done.whole
    texts = {
        "fit": {"log_posterior": f.log_posterior, "log_likelihood": f.log_likelihood, "laplace": f.laplace,
                "agree": f.agree, "swarms": f.swarms},
        "whole": {"log_value": w.log_value, "se": w.se, "method": w.method, "pareto_k": w.pareto_k,
                  "converged": w.converged, "evaluations": w.evaluations},
        "scores": [asdict(s) for s in done.scores],
        "rmse_m": done.rmse_m,
        "seconds": done.seconds,
        "spared": done.spared,
    }
    buffer = io.BytesIO()
    np.savez(
        buffer, texts=np.array(json.dumps(texts)), x=f.x, covariance=f.covariance, draws=w.draws,
        weights=w.proposal.weights, means=w.proposal.means, roots=w.proposal.roots,
    )  # fmt: skip
    write_bytes(path, buffer.getvalue())


def recall(path: Path, model: Model, assembled: Assembled) -> Done | None:
    """What `keep` wrote of this model, or None where there is no such file or it is damaged."""
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as file:
            texts = json.loads(str(file["texts"]))
            arrays = {k: file[k] for k in file.files if k != "texts"}
        x = arrays["x"]
        if x.shape != (assembled.posterior.dimension,):
            return None
        posterior = reference_at(assembled, x)
        fit = Fitted(model, assembled, posterior, x, arrays["covariance"], **texts["fit"])
        whole = Integral(
            draws=arrays["draws"], proposal=Mixture(arrays["weights"], arrays["means"], arrays["roots"]),
            **texts["whole"],
        )  # fmt: skip
        scores = tuple(LeftOut(**s) for s in texts["scores"])
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
        return None  # it is worth no more than the time it saves
    return Done(fit, whole, scores, texts["rmse_m"], texts["seconds"], bool(texts.get("spared", False)))


def scores_of(done: Done, recordings: Sequence[str]) -> Array:
    """(recordings,) log predictive densities, nan where there is none."""
    by_name = {s.recording: s.elpd for s in done.scores}
    return np.array([by_name.get(name, np.nan) for name in recordings])
