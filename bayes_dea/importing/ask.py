"""What nothing in a file decides: questions, and who answers them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bayes_dea.errors import InputError


@dataclass(frozen=True)
class Question:
    """One matter that the file leaves open.

    `key` names it for `--answer KEY=VALUE`. `choices` are the answers that are possible (empty: a number).
    `fallback` is
    what is assumed, and said to be assumed, where nobody answers; None where the recording cannot do without an answer.
    """

    key: str
    text: str
    choices: tuple[str, ...] = ()
    fallback: str | None = None

    @property
    def matter(self) -> str:
        """The key without its file."""
        return self.key.rpartition(":")[2]

    def check(self, answer: str) -> str:
        """The answer as one of the choices or a positive number. Raises InputError for anything else.

        Of columns of one name the place will do: "column 3" for "Voltage (V) in column 3".
        """
        given = answer.strip()
        if given in self.choices:
            return given
        if self.choices:
            folded = given.lower()
            found = [c for c in self.choices if c.lower() == folded]
            found = found or [c for c in self.choices if folded and c.lower().endswith(f" in {folded}")]
            if len(found) != 1:
                raise InputError(f"--answer {self.key}={given}: must be one of {', '.join(self.choices)}.")
            return found[0]
        try:
            value = float(given)
        except ValueError:
            value = 0.0
        if not 0.0 < abs(value) < 1e15:
            raise InputError(f"--answer {self.key}={given}: must be a number other than 0.")
        return given


#: answers a question, None where there is no answer
Asker = Callable[[Question], str | None]


def nobody(question: Question) -> str | None:
    """Nobody is there to answer."""
    return None


def answered(answers: Mapping[str, str], otherwise: Asker = nobody, used: set[str] | None = None) -> Asker:
    """Answers given beforehand, by key; a key may begin with "*" for all files ("*:rate_Hz").

    used: gets the keys that were asked for.
    """

    def ask(question: Question) -> str | None:
        for key in (question.key, f"*:{question.matter}"):
            if key in answers:
                if used is not None:
                    used.add(key)
                return question.check(answers[key])
        return otherwise(question)

    return ask
