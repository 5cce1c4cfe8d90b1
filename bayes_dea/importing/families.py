"""Which columns make a recording together: voltage and displacement, position and force, or none that we know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bayes_dea.importing.notebook import Notebook
from bayes_dea.importing.roles import Role
from bayes_dea.importing.shapes import filled, follows, scatter, span
from bayes_dea.importing.tables import Array

#: quantities of curves that others have worked up; they are no recordings of an actuator
_WORKED_UP = {"stress", "strain", "stretch", "frequency"}


@dataclass(frozen=True)
class Family:
    """The columns of one recording: our name -> role. `name`: voltage, mechanical, blocked_force, capacitance, free,
    open.
    """

    name: str
    columns: dict[str, Role]
    why: str = ""


def find_family(roles: Sequence[Role], time: Array, book: Notebook, rated: bool = False) -> Family:
    """Chooses the columns, asks where two could be meant, and says what the table is if it is no recording of ours.

    `time` (n,) in any unit, to judge courses by; `rated` says that a sampling rate is known although there is no time.
    """
    voltages = [r for r in roles if r.quantity == "voltage"]
    lengths = [r for r in roles if r.quantity in ("displacement", "position")]
    forces = [r for r in roles if r.quantity == "force"]
    capacitances = [r for r in roles if r.quantity == "capacitance"]
    warm = [r for r in roles if r.quantity == "temperature" and r.dimension in (None, "temperature")]
    extra = {"temperature_C": warm[0]} if warm else {}
    unknown = [r for r in roles if r.quantity is None and span(r.values) > 0]
    have = {r.quantity for r in roles}
    if capacitances and lengths:
        return Family("capacitance", {"displacement_m": lengths[0], "capacitance_F": capacitances[0], **extra})
    if voltages and lengths and not (forces and _mechanical(voltages[0], lengths[0], forces[0], time, book)):
        return _voltage_family(voltages, lengths, forces, extra, time, book)
    if lengths and forces:
        chosen = _one(lengths, "position", book)
        load = _one(forces, "force", book)
        if chosen is None or load is None:
            return Family("open", {})
        return Family("mechanical", {"position_m": chosen, "force_N": load, **extra})
    if voltages and forces:
        command = _command(voltages, time, book)
        return (
            Family("open", {})
            if command is None
            else Family(
                "blocked_force", {"voltage_V": command[0], "force_N": forces[0], **_measured(command), **extra}
            )
        )
    timed = rated or "time" in have
    nameless = all(r.column.source.name is None or r.column.source.index is not None for r in unknown)
    if unknown and not have & _WORKED_UP and (timed or nameless or voltages or lengths or forces):
        return _ask_for_columns(voltages, lengths, forces, unknown, extra, time, book)
    return _free(roles)


def _mechanical(voltage: Role, length: Role, force: Role, time: Array, book: Notebook) -> bool:
    """Whether a table with voltage, force and a length is a mechanical test, with a voltage that does nothing."""
    if span(filled(voltage.values)) <= 8.0 * scatter(voltage.values):
        book.reason(f"{voltage.column.label}: constant, so that force and position are what was tested")
        return True
    share = follows(time, voltage.values, length.values)[0]
    if share > 0.5:
        book.reason(
            f"{length.column.label}: follows the square of the voltage ({100 * share:.3g} %); the force is left out"
        )
        return False
    answer = book.question(
        "test",
        "There are voltage, force and displacement, and the displacement does not follow the "
        "voltage. What drives the test?",
        ("voltage", "position"),
    )
    return answer == "position"


def _voltage_family(
    voltages: list[Role], lengths: list[Role], forces: list[Role], extra: dict[str, Role], time: Array, book: Notebook
) -> Family:
    command = _command(voltages, time, book)
    length = _one(lengths, "displacement", book)
    if command is None or length is None:
        return Family("open", {})
    return Family("voltage", {"voltage_V": command[0], "displacement_m": length, **_measured(command), **extra})


def _measured(command: tuple[Role, Role | None]) -> dict[str, Role]:
    return {} if command[1] is None else {"measured_voltage_V": command[1]}


def _one(roles: list[Role], what: str, book: Notebook) -> Role | None:
    """The one column of a quantity; own names and quantity words first, else asked."""
    if len(roles) == 1:
        return roles[0]
    ours = [r for r in roles if r.ours is not None and r.quantity == what]
    exact = ours or [r for r in roles if r.quantity == what and not r.weak and span(r.values) > 0]
    if len(exact) == 1:
        chosen = exact[0]
        others = "; ".join(_passed_over(r, what) for r in roles if r is not chosen)
        own = ", the project's own name" if ours else ""
        book.reason(f'{what} is "{chosen.column.label}"{own}; {others}')
        return chosen
    names = tuple(r.column.label for r in roles)
    answer = book.question(
        what, f"Several columns could be the {what}: {', '.join(names)}. Which?{_short(roles)}", names
    )
    return next((r for r in roles if r.column.label == answer), None)


def _passed_over(role: Role, what: str) -> str:
    """Why a column is not the one of its quantity."""
    if span(role.values) == 0:
        return f'"{role.column.label}" does not change'
    return f'"{role.column.label}" is left out' + (
        f", named like a {role.quantity}" if role.quantity != what else ", a letter only" if role.weak else ""
    )


def _short(roles: Sequence[Role]) -> str:
    """How to name one of several columns of one name."""
    twice = next((r.column for r in roles if r.column.heading is not None), None)
    if twice is None:
        return ""
    place = twice.label.removeprefix(f"{twice.heading} in ")
    return f' ("{place}" is enough.)'


def _command(voltages: list[Role], time: Array, book: Notebook) -> tuple[Role, Role | None] | None:
    """(command, reading or None)."""
    if len(voltages) == 1:
        return voltages[0], None
    commands = [v for v in voltages if v.variant == "command" or v.ours == "voltage_V"]
    readings = [v for v in voltages if v.variant == "measured"]
    if len(voltages) == 2 and len(commands) == 1 and len(readings) == 1:
        book.reason(
            f'voltage_V is "{commands[0].column.label}", measured_voltage_V "{readings[0].column.label}", by their '
            "names"
        )
        return commands[0], readings[0]
    if len(voltages) == 2:
        a, b = sorted(voltages, key=lambda v: scatter(v.values))
        if (
            abs(span(a.values) / max(span(b.values), 1e-300) - 1.0) < 0.1
            and a.unit == b.unit
            and (scatter(a.values) < 0.3 * scatter(b.values))
            and np.corrcoef(filled(a.values), filled(b.values))[0, 1] > 0.9
        ):
            book.reason(f'voltage_V is "{a.column.label}": free of noise; "{b.column.label}" is its reading')
            return a, b
    names = tuple(v.column.label for v in voltages)
    answer = book.question(
        "voltage",
        f"Several columns are voltages: {', '.join(names)}. Which is the command to the actuator?{_short(voltages)}",
        names,
    )
    chosen = next((v for v in voltages if v.column.label == answer), None)
    return None if chosen is None else (chosen, None)


def _ask_for_columns(
    voltages: list[Role],
    lengths: list[Role],
    forces: list[Role],
    unknown: list[Role],
    extra: dict[str, Role],
    time: Array,
    book: Notebook,
) -> Family:
    """Columns whose names say nothing: a person knows which is the voltage and which the answer."""
    names = tuple(r.column.label for r in unknown)
    said = ", ".join(f'"{n}"' for n in names)

    def pick(what: str, left: list[Role]) -> Role | None:
        choices = (*(r.column.label for r in left), "none")
        text = f"Nothing says what the columns {said} are. Which is the {what}?{_short(left)}"
        answer = book.question(what, text, choices)
        chosen = next((r for r in left if r.column.label == answer), None)
        return None if chosen is None else replace(chosen, quantity=what, level="said", why="as you answered")

    left = list(unknown)
    drive = voltages[0] if voltages else (pick("voltage", left) if not forces else None)
    left = [r for r in left if drive is None or r.column is not drive.column]
    answer = lengths[0] if lengths else (pick("displacement", left) if left else None)
    if drive is not None and answer is not None:
        return Family("voltage", {"voltage_V": drive, "displacement_m": answer, **extra})
    if forces and answer is not None:
        return Family("mechanical", {"position_m": answer, "force_N": forces[0], **extra})
    return Family("open", {})


def _free(roles: Sequence[Role]) -> Family:
    kinds = ", ".join(
        dict.fromkeys(
            str(r.quantity or f'"{r.column.label}"')
            for r in roles
            if r.quantity not in ("index", "run", "other time", "date")
        )
    )
    return Family("free", {}, f"no recording of an actuator that we know: it holds {kinds}")
