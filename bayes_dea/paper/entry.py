"""A number of the paper and ours beside it: what `paper.json` lists."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..results import plain


@dataclass(frozen=True)
class Entry:
    """One printed value (or conclusion) and what we find for it.

    `where`: "Table SIV", "Figure 9", "Section III.B"; `entry`: what it is, e.g. "Yeoh C_2". `printed` and `ours` are
    numbers in `unit` (SI, "1" where there is none), or short texts for conclusions; `printed` is None where the paper
    gives the value only inside a figure. `ours_sd`: posterior sd of `ours`, None where it has none. `agrees`: None
    where nothing printed can be compared. `why_not`: why it differs or cannot be compared or reproduced, "" where it
    agrees. `circular`: ours was put in when the recordings were reconstructed, so that an agreement shows nothing but
    that the procedure returns it; counted as no agreement.
    """

    where: str
    entry: str
    printed: float | str | None
    ours: float | str | None
    ours_sd: float | None
    unit: str
    agrees: bool | None
    why_not: str = ""
    circular: bool = False

    def __post_init__(self) -> None:
        if self.agrees is False and not self.why_not:
            raise ValueError(f"{self.where}, {self.entry}: differs without a reason")

    def json(self) -> dict[str, Any]:
        """As in paper.json; non-finite numbers are None."""
        content: dict[str, Any] = plain(vars(self))
        return content
