"""What is decided about one inconsistency of the paper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from .entry import Entry

#: misprint: the printed value is wrong; artefact: right, but not what it is taken for; stands: right; open: not decided
VERDICTS = ("misprint", "artefact", "stands", "open")


@dataclass(frozen=True)
class Decision:
    """One item of the list: printed value, value decided for, the figures that decide by name, and a sentence.

    `item` counts as the list of the paper's inconsistencies does; `where` is a table or section of the paper.
    """

    item: int
    where: str
    what: str
    printed: float | str | None
    decided: float | str | None
    unit: str
    verdict: str
    sentence: str
    figures: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.verdict not in VERDICTS:
            raise ValueError(f"item {self.item}: verdict {self.verdict!r} is none of {', '.join(VERDICTS)}")

    def entry(self) -> Entry:
        """As it stands in paper.json."""
        agrees = {"misprint": False, "artefact": False, "stands": True, "open": None}[self.verdict]
        return Entry(self.where, f"item {self.item}: {self.what}", self.printed, self.decided, None, self.unit, agrees,
                     self.sentence)
