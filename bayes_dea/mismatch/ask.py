"""Which experiment would split the explanations that remain, or else sharpen the one that was found."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..campaign import recording_from_arrays
from ..campaign.schema import Actuator
from ..models.nodes import make_nodes
from ..models.plant import plant_of
from ..models.simulate_plant import simulate_nodes, simulate_plates
from .refit import Fit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Proposal:
    """An experiment of the menu: kind, settings as next.json states them, and its command."""

    kind: str
    settings: dict[str, float]
    time_s: Array
    column: str  # voltage_V or position_m
    values: Array
    rest_s: float = 600.0

    @property
    def cost_s(self) -> float:
        """Bench time with the rest before it."""
        return float(self.time_s[-1]) + self.rest_s


def menu(actuator: Actuator, mechanical: bool = True) -> list[Proposal]:
    """Experiments that the bench can do within the actuator's limits."""
    top = actuator.max_voltage_V or 1200.0
    fastest = actuator.max_frequency_Hz or 100.0
    out = []
    for share in (0.5, 1.0):
        t = np.arange(0.0, 61.0, 0.002)
        out.append(
            Proposal(
                "creep",
                {"voltage_V": share * top, "duration_s": 60.0},
                t,
                "voltage_V",
                np.where(t > 0.5, share * top, 0.0),
            )
        )
    t = np.arange(0.0, 92.0, 0.002)
    stairs = np.concatenate([np.arange(1, 7), np.arange(5, -1, -1), [3.0]]) / 6 * top
    out.append(
        Proposal(
            "voltage",
            {"voltage_V": top, "duration_s": 92.0},
            t,
            "voltage_V",
            np.where(t > 0.5, stairs[np.minimum((t - 0.5) / 7, 12).astype(int)], 0.0),
        )
    )
    for frequency in (0.1, 1.0, 10.0, 40.0):
        if frequency > fastest:
            continue
        length = max(5.0 / frequency, 5.0)
        t = np.arange(0.0, length, min(0.001, 0.01 / frequency))
        for kind, offset, amplitude in (
            ("sine", 0.54 * top, 0.33 * top),
            ("rectangle", 0.54 * top, 0.33 * top),
            ("sine", 0.8 * top, 0.08 * top),
            ("sine", 0.5 * top, 0.5 * top),
        ):
            wave = np.sin(2 * np.pi * frequency * t)
            wave = np.sign(wave) if kind == "rectangle" else wave
            out.append(
                Proposal(
                    kind,
                    {
                        "frequency_Hz": frequency,
                        "voltage_V": offset,
                        "amplitude_V": amplitude,
                        "duration_s": float(length),
                    },
                    t,
                    "voltage_V",
                    np.where(t > 0.25, offset + amplitude * wave, 0.0),
                )
            )
    if mechanical and actuator.stack_height_m and actuator.total_area_m2:
        h = actuator.stack_height_m
        t = np.arange(0.0, 64.0, 0.02)
        out.append(
            Proposal(
                "compression",
                {"amplitude_m": 0.1 * h, "duration_s": 64.0},
                t,
                "position_m",
                0.1 * h * (1 - np.abs((t % 20.0) / 10.0 - 1)) * (t < 60),
            )
        )
        out.append(
            Proposal(
                "relaxation",
                {"amplitude_m": 0.1 * h, "duration_s": 64.0},
                t,
                "position_m",
                0.1 * h * np.clip((t - 1) / 0.3, 0, 1),
            )
        )
    return out


def answer(fit: Fit, p: Proposal, actuator: Actuator, q: Array | None = None) -> tuple[Array, Array] | None:
    """Answer of a fit to a proposal: block-free values at nodes (m,) and the samples each stands for (m,)."""
    x = fit.q if q is None else q
    model = fit.problem.model
    values = {k: float(v[0]) for k, v in model.physical(x[None, : model.dimension]).items()}
    plant = plant_of(model, values, actuator)
    if p.column == "voltage_V":
        recording = recording_from_arrays(
            "next",
            p.kind,
            {"time_s": p.time_s, "voltage_V": p.values, "displacement_m": np.zeros(p.time_s.size)},
            "identify",
            actuator,
        )
        nodes = make_nodes(recording)
        y = simulate_nodes(plant, nodes)
        weight = np.gradient(nodes.row.astype(float)) if nodes.row.size > 1 else np.ones(1)
        return (y, weight) if np.isfinite(y).all() else None
    y = simulate_plates(plant, p.time_s, p.values, 0.0, 1)
    return (y, np.ones(y.size)) if np.isfinite(y).all() else None


def separation(a: Fit, b: Fit, p: Proposal, actuator: Actuator) -> float:
    """Expected log evidence ratio in nats between two fits after the experiment, what both could refit taken out."""
    first, second = answer(a, p, actuator), answer(b, p, actuator)
    if first is None or second is None or first[0].size != second[0].size:
        return 0.0
    y, weight = first
    d = y - second[0]
    channel = "displacement" if p.column == "voltage_V" else "force"
    sigma = a.noise.sigma.get(channel, 0.005 if channel == "force" else 4.7e-6)
    rho = a.noise.rho.get(channel, (0.0,))[0]
    w = np.sqrt(weight) / (sigma * math.sqrt(max((1 + rho) / (1 - rho), 1e-3)))
    columns = [np.ones_like(y)]
    information = [0.0]
    for i in range(b.problem.model.dimension):
        q = b.q.copy()
        h = 0.3 * math.sqrt(max(b.covariance[i, i], 1e-18))
        q[i] += h
        moved = answer(b, p, actuator, q)
        if moved is not None and moved[0].size == y.size:
            columns.append((moved[0] - second[0]) / h)
            information.append(1.0 / max(b.covariance[i, i], 1e-18))
    A = np.stack(columns, axis=1) * w[:, None]
    H = A.T @ A + np.diag(information)
    g = A.T @ (w * d)
    scale = 1 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    x = scale * np.linalg.lstsq((H * scale).T * scale, scale * g, rcond=1e-12)[0]
    return max(0.0, 0.5 * float(np.sum((w * d) ** 2) - g @ x))


def first_experiment(base: Fit, actuator: Actuator) -> dict[str, Any]:
    """The experiment that teaches most of the model itself, an hour: for recordings that tell nothing yet.

    Information is half the log of one plus the squared size in sds that each parameter's posterior still moves the
    answer by, its mean taken out; parameters are counted as if independent.
    """
    best: tuple[float, float, Proposal] | None = None
    sd = np.sqrt(np.maximum(np.diag(base.covariance), 0.0))
    for p in menu(actuator):
        if p.column != "voltage_V":
            continue
        plain = answer(base, p, actuator)
        if plain is None:
            continue
        y, weight = plain
        sigma, rho = base.noise.sigma["displacement"], base.noise.rho["displacement"][0]
        w = weight / (sigma**2 * max((1 + rho) / (1 - rho), 1e-3))
        nats = 0.0
        for i in range(base.problem.model.dimension):
            q = base.q.copy()
            h = min(float(sd[i]), 1.0)
            q[i] += h
            moved = answer(base, p, actuator, q)
            if moved is not None and moved[0].size == y.size:
                d = moved[0] - y
                d = d - float(w @ d / w.sum())
                nats += 0.5 * math.log1p(float(w @ d**2))
        rate = nats * 3600.0 / p.cost_s
        if best is None or rate > best[0]:
            best = (rate, nats, p)
    if best is None:
        return {"why": "no experiment of the menu has an answer", "recording": {}}
    rate, nats, p = best
    return {
        "why": f"the recordings at hand tell too little of the model itself: about {nats:.3g} nats expected",
        "recording": {"kind": p.kind, **p.settings},
        "expected_information_nats": nats,
        "cost_s": p.cost_s,
        "nats_per_hour": rate,
    }


def next_experiment(fits: list[Fit], names: list[str], actuator: Actuator) -> dict[str, Any]:
    """The experiment with the largest expected separation of the two likeliest explanations per hour."""
    if len(fits) < 2:
        return {}
    scored = []
    for p in menu(actuator):
        nats = separation(fits[0], fits[1], p, actuator)
        scored.append((nats * 3600.0 / p.cost_s, nats, p))
    rate, nats, p = max(scored, key=lambda s: s[0])
    worth = "" if nats >= 3.0 else "; no experiment of the menu would be decisive"
    return {
        "why": f"splits {names[0]} from {names[1]}: about {min(nats, 1e6):.3g} nats expected{worth}",
        "recording": {"kind": p.kind, **p.settings},
        "expected_information_nats": nats,
        "cost_s": p.cost_s,
        "nats_per_hour": rate,
    }
