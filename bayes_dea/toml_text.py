"""TOML of the user's: tomllib, and errors for what it takes, or stumbles over, that no setting can be."""

from __future__ import annotations

import re
import tomllib
from typing import Any

from .errors import InputError

#: TOML promises whole numbers of 64 bits; what is longer cannot become a number of the model
_LARGEST = 2**63 - 1
#: digits of a whole number that Python will read
_DIGITS = 4300
_DEEPEST = 60


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """The tables of a TOML text; messages call it `where`.

    Raises tomllib.TOMLDecodeError as tomllib does, and InputError, naming the key, for whole numbers beyond 64 bits and
    for brackets within brackets without end.
    """
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except RecursionError:
        raise InputError(_too_deep(where, "")) from None
    except ValueError as error:  # a number that Python does not read
        for number, line in enumerate(text.splitlines(), start=1):
            if re.search(rf"\d[\d_]{{{_DIGITS - 1},}}", line):
                raise InputError(_too_long(f"{where}, line {number}", line.partition("=")[0].strip())) from None
        raise InputError(f"{where}: this is no valid TOML ({error}). Correct it.") from None
    left: list[tuple[str, Any, int]] = [("", table, 0)]
    while left:
        key, value, depth = left.pop()
        if depth > _DEEPEST:
            raise InputError(_too_deep(where, key.split("[")[0]))
        if isinstance(value, dict):
            left += [(f"{key}.{k}" if key else k, v, depth + 1) for k, v in value.items()]
        elif isinstance(value, list):
            left += [(f"{key}[{i}]", v, depth + 1) for i, v in enumerate(value, start=1)]
        elif isinstance(value, int) and abs(value) > _LARGEST:
            raise InputError(_too_long(where, key))
    return table


def _too_long(where: str, key: str) -> str:
    return f"{where}: {key} is a whole number of more than 19 digits, which cannot be meant. Correct it."


def _too_deep(where: str, key: str) -> str:
    return f"{where}: {key or 'a value'} has brackets within brackets more than {_DEEPEST} deep. Correct it."
