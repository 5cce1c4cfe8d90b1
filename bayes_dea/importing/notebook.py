"""What was decided about one table, with the reasons: said, inferred, assumed, or left open."""

from __future__ import annotations

from dataclasses import dataclass, field

from bayes_dea.importing.ask import Asker, Question


@dataclass
class Notebook:
    """Collects decisions about one table and asks where nothing decides."""

    label: str
    ask: Asker
    reasons: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)
    open: list[str] = field(default_factory=list)
    asked: int = 0

    def reason(self, text: str) -> None:
        """A decision with its reason."""
        if text not in self.reasons:
            self.reasons.append(text)

    def assume(self, text: str) -> None:
        """A guess that a person has to look at."""
        if text not in self.assumed:
            self.assumed.append(text)

    def question(
        self, matter: str, text: str, choices: tuple[str, ...] = (), fallback: str | None = None
    ) -> str | None:
        """An answer to what the file leaves open, or the fallback, or None; whichever it is, it is noted."""
        question = Question(f"{self.label}:{matter}", text, choices, fallback)
        self.asked += 1
        answer = self.ask(question)
        if answer is not None:
            self.reason(f"{matter} = {answer}: as you answered")
            return answer
        remedy = f'--answer "{question.key}={"|".join(choices) if choices else "NUMBER"}"'
        if fallback is not None:
            self.assume(f"{text} Taken: {fallback}. Otherwise: {remedy}.")
            return fallback
        self.open.append(f"{text} Answer with {remedy}.")
        return None
