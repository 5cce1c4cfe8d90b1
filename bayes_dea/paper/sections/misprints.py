"""The 35 inconsistencies of the paper, each decided by a computation from the printed numbers where they suffice."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from .. import misprint_geometry as geometry
from .. import misprint_kelvin as kelvin
from .. import misprint_material as material
from .. import misprint_state as state
from ..misprint_decision import Decision
from ..printed import Printed, printed
from ..section import Paragraph, Section, Task

ITEMS: tuple[Callable[[Printed], Decision], ...] = (
    geometry.vacuum_permittivity,
    geometry.creep_area,
    geometry.whose_sides,
    geometry.creep_height,
    geometry.stack_length,
    material.damper_unit,
    material.rate_unit,
    material.signs,
    material.gent,
    material.ogden,
    kelvin.term_of_B,
    kelvin.damper_n,
    kelvin.other_coefficients,
    geometry.moving_mass,
    material.damper_start,
    kelvin.fastest_rate,
    kelvin.middle_rate,
    kelvin.slow_rate,
    kelvin.lowest_voltage,
    state.first_pole,
    state.integrator,
    state.double_pole,
    state.rounded_elements,
    state.gain_unit,
    state.sample_time,
    geometry.strokes,
    geometry.load_cell,
    geometry.manufacturer_modulus,
    material.four_elements,
    kelvin.average_beats_own,
    kelvin.rising_r2,
    state.downsampling,
    geometry.two_masses,
    geometry.other_actuator,
)


def editorial(p: Printed) -> Decision:
    """Item 33: slips of names and numbers, which no computation decides."""
    return Decision(
        33, "Eq. (12), Tables I, II, SIX, Section IV.D", "names and numbers of tables, figures and symbols",
        "eps_0 twice, model 5 for 4, \"Figure 4\" for 16, \"SIX S5\", two Tables "
        "II", "read from the context", "1", "open",
        "Eq. (12) calls the strain eps_0 like the permittivity, Table I numbers the state space 5 and the text 4, "
        "Section IV.D "
        "says Figure 4 for Figure 16, GKM and GKV change places once in Section III.D: slips of the text, of which no "
        "number "
        "decides anything",
    )  # fmt: skip


def decide(paper: Printed) -> tuple[Decision, ...]:
    """All 35, in order."""
    return tuple(sorted((f(paper) for f in (*ITEMS, editorial)), key=lambda d: d.item))


def run(task: Task) -> Section:
    """Decide all items."""
    began = time.perf_counter()
    paper = printed()
    done: list[Decision] = []
    functions = (*ITEMS, editorial)
    for i, f in enumerate(functions):
        task.report("misprints", i, len(functions))
        done.append(f(paper))
    task.report("misprints", len(functions), len(functions))
    done.sort(key=lambda d: d.item)
    return Section(
        "misprints",
        "The misprints",
        _paragraphs(done),
        tuple(d.entry() for d in done),
        {"misprints": {"items": [_row(d) for d in done]}},
        (),
        time.perf_counter() - began,
    )


def _row(d: Decision) -> dict[str, Any]:
    return {
        "item": d.item, "where": d.where, "what": d.what, "printed": d.printed, "decided": d.decided, "unit": d.unit,
        "verdict": d.verdict, "sentence": d.sentence, "figures": dict(d.figures),
    }  # fmt: skip


def _begun(sentence: str) -> str:
    """With a capital, unless it begins with a symbol."""
    first = sentence.split()[0]
    symbol = not first.isalpha() or first in ("alpha", "tau", "lam", "eta", "k", "d")
    return sentence if symbol else sentence[0].upper() + sentence[1:]


def _numbers(done: list[Decision], verdict: str) -> str:
    return ", ".join(str(d.item) for d in done if d.verdict == verdict) or "none"


def _paragraphs(done: list[Decision]) -> tuple[Paragraph, ...]:
    count = {v: sum(d.verdict == v for d in done) for v in ("misprint", "artefact", "stands", "open")}
    return (
        Paragraph(
            "Tables I to SX",
            "What is misprinted, and what was used instead",
            f"Of {len(done)} places where the paper contradicts itself or physics, {count['misprint']} are misprints "
            "or wrong "
            f"statements whose value the other printed numbers decide (items {_numbers(done, 'misprint')}); "
            f"{count['artefact']} "
            "are numbers that are printed as they were found but are not what they are taken for, such as a bound of "
            "a fit "
            f"read as a property (items {_numbers(done, 'artefact')}); {count['stands']} stand as printed "
            f"(items {_numbers(done, 'stands')}); {count['open']} cannot be decided from the printed numbers "
            f"(items {_numbers(done, 'open')}) and are listed with what is missing. Each is decided by a computation "
            "of its "
            "own from the printed tables; the sentence gives its figures. Everything else in this companion uses the "
            "mended values.",
            "misprints",
            "Numbers are those of the list; colours and rows say what the computation decided.",
        ),
        *(
            Paragraph(f"Item {d.item}", f"{d.where}: {d.what}", _begun(d.sentence) + ".")
            for d in done
        ),
    )
