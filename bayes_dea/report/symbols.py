"""Names of parameters as symbols: ``tau_1_s`` and its label ``$\\tau_1$`` become a Greek letter with an index."""

from __future__ import annotations

import re

from markupsafe import Markup

_GREEK = {
    "alpha": "α",
    "beta": "β",
    "gamma": "γ",
    "delta": "δ",
    "epsilon": "ε",
    "eta": "η",
    "theta": "θ",
    "kappa": "κ",
    "lambda": "λ",
    "mu": "µ",
    "nu": "ν",
    "xi": "ξ",
    "rho": "ρ",
    "sigma": "σ",
    "tau": "τ",
    "phi": "φ",
    "omega": "ω",
    "zeta": "ζ",
    "infty": "∞",
}
_SUBSCRIPT = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_CHANNEL_UNITS = ("m", "N", "V", "F", "A", "C", "1")


def parts(name: str, label: str | None = None) -> tuple[str, str]:
    """Letter and index of a parameter, either of which may be empty; `label` is simple TeX or None."""
    if label and label.startswith("$") and label.endswith("$"):
        text = re.sub(r"\\([A-Za-z]+)\s*", lambda m: _GREEK.get(m.group(1), m.group(1)), label[1:-1])
        match = re.fullmatch(r"([^_{}^\\$]+)(?:_(?:\{([^{}]*)\}|(.)))?", text)
        if match:
            return match.group(1).strip(), match.group(2) or match.group(3) or ""
    if label and "$" not in label and label != name:
        return label, ""
    for head, symbol in (("sigma_", "σ"), ("rho_", "ρ"), ("gain_", "gain"), ("zero_", "zero")):
        if name.startswith(head):
            words = name[len(head) :].split("_")
            if head in ("sigma_", "zero_") and len(words) > 1 and words[-1] in _CHANNEL_UNITS:
                words = words[:-1]
            return symbol, " ".join(words)
    return name, ""


def plain(name: str, label: str | None = None) -> str:
    """Symbol for a picture: digits as index, anything else behind the letter."""
    letter, index = parts(name, label)
    if not index:
        return letter
    return letter + index.translate(_SUBSCRIPT) if index.isdigit() else f"{letter} {index}"


def html(name: str, label: str | None = None) -> Markup:
    """Symbol for the page, escaped."""
    letter, index = parts(name, label)
    return Markup("<i>{}</i><sub>{}</sub>").format(letter, index) if index else Markup("<i>{}</i>").format(letter)
