"""What a part of the redone paper hands on: entries, a paragraph for each figure or table, the data of the pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .entry import Entry

#: (what is being done, done so far, of how many)
Report = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Paragraph:
    """The companion's text to one table or figure of the paper, which keeps its number.

    `number`: "Table SIV", "Figure 7"; `title`: a line; `text`: one paragraph of plain text; `picture`: key into
    `Section.data` of what is drawn beside it ("" for none); `caption`: what to see in the picture.
    """

    number: str
    title: str
    text: str
    picture: str = ""
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """`name` is that of its module; `data` holds by picture what its drawing needs (lists and numbers, JSON-able)."""

    name: str
    title: str
    paragraphs: tuple[Paragraph, ...]
    entries: tuple[Entry, ...]
    data: dict[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0


@dataclass(frozen=True)
class Task:
    """What every section is run with: seed (each section derives its own generator from it), threads, progress."""

    seed: int
    workers: int
    report: Report

    def generator(self, name: str) -> np.random.Generator:
        """The generator of a section: the same whichever sections run before it."""
        return np.random.default_rng([self.seed, *name.encode()])
