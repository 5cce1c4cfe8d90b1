"""Inconsistencies of the discrete state space of Table SVIII and of the sampling."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .misprint_decision import Decision
from .printed import Printed, StateSpaceRow

Array = NDArray[np.float64]
#: input scale of the printed realisation: B_3 Ts -> 64 Ts and so on
_SCALE = 64.0


def dc_gain(row: StateSpaceRow, A11: float | None = None) -> float:
    """C (I - A)^-1 B, with another first pole if given."""
    A = row.A_used
    if A11 is not None:
        A[0, 0] = A11
    return float(row.C @ np.linalg.solve(np.eye(3) - A, row.B))


def _integrate(row: StateSpaceRow, A11: float, rows: int) -> float:
    x = np.zeros(3)
    A = row.A.copy()
    A[0, 0] = A11
    for _ in range(rows - 1):
        x = A @ x + row.B
    return float(row.C @ x)


def _hooke_m(p: Printed, voltage: float) -> float:
    length = p.constants["layers"].used * p.constants["layer_thickness_m"].used
    return float(p.passive_stress(voltage)) / p.maxwell.Y_Pa * length


def first_pole(p: Printed) -> Decision:
    """Item 20."""
    step = 0.5e-4
    Ts = p.state_space[1200].sample_time_s
    tau = [-Ts / np.log(0.9999 + s) for s in (-step, 0.0, step)]
    row = p.state_space[1200]
    gains = [dc_gain(row, 0.9999 + s) for s in (-step, 0.0, step)]
    spread = [
        (dc_gain(r, r.A[0, 0] - step) / dc_gain(r) - 1, dc_gain(r, r.A[0, 0] + step) / dc_gain(r) - 1)
        for v, r in p.state_space.items() if r.A[0, 0] == 0.9999 and v >= 400
    ]
    apart = [
        _hooke_m(p, v) * r.step(60001)[-1] / float(p.creep_displacement(v, 600.0)) - 1
        for v, r in p.state_space.items() if v >= 400
    ]
    return Decision(
        20, "Table SVIII", "A_11 = 0.9999", 0.9999, "0.99985 to 0.99995", "1", "artefact",
        f"four decimals leave a time constant of {tau[0]:.0f} to {tau[2]:.0f} s ({tau[1]:.0f} s as printed), so the "
        "gain at rest "
        f"is uncertain by {100 * min(a for a, _ in spread):.0f} to {100 * max(b for _, b in spread):+.0f} % (1200 V: "
        f"{gains[0]:.2f} to {gains[2]:.2f}). At 600 s the table is within {100 * max(abs(x) for x in apart):.1f} % of "
        "Table SVII "
        "from 400 V up, and usable that far",
        {"tau_low_s": float(tau[0]), "tau_high_s": float(tau[2]), "gain_low": gains[0], "gain_high": gains[2],
         "apart_600_s": float(max(abs(x) for x in apart))},
    )  # fmt: skip


def integrator(p: Printed) -> Decision:
    """Item 21."""
    row = p.state_space[300]
    hooke = _hooke_m(p, 300)
    printed, used = (hooke * _integrate(row, a, 60001) for a in (row.A[0, 0], row.A11_used))
    table = float(p.creep_displacement(300, 600.0))
    return Decision(
        21, "Table SVIII", "A_11 at 300 V", float(row.A[0, 0]), row.A11_used, "1", "misprint",
        f"A_11 = 1 is an integrator: {printed * 1e6:.1f} um at 600 s and no end, {100 * (printed / used - 1):.0f} % "
        "above the "
        f"{used * 1e6:.1f} um of 0.99995, which rounds to 1.0000; Table SVII has {table * 1e6:.1f} um",
        {"printed_m": printed, "used_m": used, "table_m": table},
    )  # fmt: skip


def double_pole(p: Printed) -> Decision:
    """Item 22."""
    row = p.state_space[100]
    tau = 1.0 / row.poles_per_s
    others = [float(1.0 / r.poles_per_s[0]) for v, r in p.state_space.items() if v != 100]
    return Decision(
        22, "Table SVIII", "row of 100 V", "A_22 = A_33 = 0.5089", "discard", "1", "artefact",
        f"a double pole of {1e3 * tau[1]:.1f} ms and a slow one of {tau[0]:.0f} s, where the other rows have "
        f"{min(others):.0f} to "
        f"{max(others):.0f} s: out of the family, at 1 um against 4.7 um of fluctuation",
        {"tau_1_s": float(tau[0]), "double_s": float(tau[1])},
    )  # fmt: skip


def rebuilt(row: StateSpaceRow) -> tuple[float, float, float]:
    """A_23, B_2 and B_3 of the cascade (1 - A)/p of a PZ3 under a hold of order zero, from the diagonal alone."""
    p = row.poles_per_s
    A22, A33 = row.A[1, 1], row.A[2, 2]
    B3 = _SCALE * (1 - A33) / p[2]
    if A22 == A33:
        return row.sample_time_s * A22, float("nan"), B3
    A23 = (A22 - A33) / (p[2] - p[1])
    B2 = _SCALE / (p[2] - p[1]) * ((1 - A22) / p[1] - (1 - A33) / p[2])
    return float(A23), float(B2), float(B3)


def rounded_elements(p: Printed) -> Decision:
    """Item 23."""
    good_A, good_B2, good_B3, lost = 0, 0, 0, []
    for v, row in p.state_space.items():
        A23, B2, B3 = rebuilt(row)
        good_A += abs(A23 - row.A[1, 2]) <= 0.5001e-4
        good_B2 += abs(B2 - row.B[1]) <= 0.5001e-4
        # B_3 follows A_33, of which four decimals are printed
        slack = 0.5001e-4 + abs(_SCALE * 0.5e-4 / row.poles_per_s[2]) + abs(B3 / row.poles_per_s[2]) * 0.5e-4 / (
            row.A[2, 2] * row.sample_time_s)
        scale = 0.5 if v == 100 else 1.0
        good_B3 += abs(scale * B3 - row.B[2]) <= slack
        lost.append(0.5e-4 / row.B[1])
    return Decision(
        23, "Table SVIII", "A_23 and B_2 in four decimals", "rounded", "rebuilt from the poles", "1", "artefact",
        f"B_2 of 0.0010 to 0.0020 in four decimals is uncertain by {100 * min(lost):.1f} to {100 * max(lost):.1f} %. "
        "As the step "
        f"response of a PZ3 cascade held for 10 ms the poles give A_23 in {good_A} of 12 rows, B_2 in {good_B2} of "
        "the 11 with "
        f"different poles and B_3 in {good_B3} of 12 (half the scale at 100 V) to the last printed digit: the table is "
        "that cascade, and the lost digits come back",
        {"A23": float(good_A), "B2": float(good_B2), "B3": float(good_B3), "lost_most": max(lost)},
    )  # fmt: skip


def gain_unit(p: Printed) -> Decision:
    """Item 24."""
    gains = {v: dc_gain(r) for v, r in p.state_space.items()}
    ratio = [
        _hooke_m(p, v) * r.step(3001)[-1] / float(p.creep_displacement(v, 30.0))
        for v, r in p.state_space.items() if v >= 600
    ]
    as_volts = gains[1200] * 1200.0
    return Decision(
        24, "Table SVIII", "unit of the gain", "none given", "um measured per um of Hooke", "1", "misprint",
        f"gains at rest run from {gains[100]:.2f} (100 V) to {gains[1200]:.2f} (1200 V); times Hooke's displacement "
        "they return "
        f"Table SVII within {100 * max(abs(x - 1) for x in ratio):.0f} % at 30 s (600 V and more). Read as um/V, 1200 "
        "V would make "
        f"{as_volts:.0f} um",
        {"gain_100": gains[100], "gain_600": gains[600], "gain_1200": gains[1200],
         "apart_30_s": float(max(abs(x - 1) for x in ratio))},
    )  # fmt: skip


def sample_time(p: Printed) -> Decision:
    """Item 25."""
    step = p.validation["fixed_step_s"].used
    Ts = p.state_space[600].sample_time_s
    lags = [float(np.sum(1.0 / r.poles_per_s[1:])) for v, r in p.state_space.items() if v >= 200]
    fast = float(np.median(lags))
    return Decision(
        25, "Section III.D", "step of Model 4 in the simulation", step, Ts, "s", "open",
        f"the matrices belong to {1e3 * Ts:.0f} ms (item 23). If they were stepped at {1e3 * step:.0f} ms, everything "
        "would be "
        f"{Ts / step:.0f} times too fast and the two lags {1e3 * fast * step / Ts:.1f} ms in place of "
        f"{1e3 * fast:.0f} ms; the "
        "sample time of the block is not stated, so whether it happened cannot be decided from the print",
        {"lags_s": fast, "too_fast": Ts / step},
    )  # fmt: skip


def downsampling(p: Printed) -> Decision:
    """Item 32."""
    rate = p.creep["sampling_Hz"].used / p.creep["downsample"].used
    mains, delay = 50.0, p.constants["acquisition_delay_s"].used
    t = np.arange(0, 4000) / rate
    # a mains line 0.05 Hz off its name, as it is on most days
    kept = np.sin(2 * np.pi * (mains + 0.05) * t)
    slow = kept * np.where(np.arange(t.size) % 2, -1.0, 1.0)
    swing = float(np.ptp(slow)) / 2
    return Decision(
        32, "Section III.C", "every tenth row, without a "
                             "filter", "downsample by 10", "average, or fit at 1 kHz", "1", "artefact",
        f"at {rate:.0f} Hz the mains line of 50 Hz lies on the Nyquist frequency of {rate / 2:.0f} Hz and beats: 0.05 "
        "Hz off its "
        f"name it is kept in full ({swing:.2f} of its amplitude) and swings in {1 / 0.05:.0f} s. The delay of "
        f"{1e3 * delay:.0f} ms is resolved to {1e3 / rate:.0f} ms",
        {"nyquist_Hz": rate / 2, "kept": swing, "delay_steps": delay * rate},
    )  # fmt: skip
