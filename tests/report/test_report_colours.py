"""Colours that are told apart in grey, and by those who see two of the three primaries."""

import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from bayes_dea.report import style

TEMPLATES = Path(style.__file__).parent / "templates"
# dichromats and greyscale as matrices on linear RGB (Machado, Oliveira, Fernandes 2009, severity 1; Rec. 709 luminance)
SIGHT = {
    "all three": np.eye(3),
    "no red cones": np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                              [-0.003882, -0.048116, 1.051998]]),
    "no green cones": np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                                [-0.011820, 0.042940, 0.968881]]),
    "no blue cones": np.array([[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                               [0.004733, 0.691367, 0.303900]]),
    "grey": np.tile([0.2126, 0.7152, 0.0722], (3, 1)),
}
#: what lies beside or over each other in one picture
TOGETHER = {
    "measured and predicted": (style.BLACK, style.BLUE, style.BAND_50, style.BAND_90, "#ffffff"),
    "bars under bands": (style.BLACK, style.BLUE, style.BAR, "#ffffff"),
    "mean and RMS": (style.BLUE, style.VERMILLION, "#ffffff"),
    "prior and posterior": (style.PRIOR, style.BLUE, style.PRIOR_AREA),
    "MAP on its regions": (style.VERMILLION, style.BAND_50, style.BAND_90),
}


def linear(color: str) -> np.ndarray:
    c = np.array([int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    """CIE 1976 L*a*b* of linear RGB, D65."""
    m = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
                  [0.0193339, 0.1191920, 0.9503041]])
    x = m @ np.clip(rgb, 0, 1) / (m @ np.ones(3))
    f = np.where(x > (6 / 29) ** 3, np.cbrt(x), x / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def difference(a: str, b: str, sight: str) -> float:
    """CIE 1976 difference of two colours as somebody sees them; 2.3 is just noticeable."""
    m = SIGHT[sight]
    return float(np.linalg.norm(lab(m @ linear(a)) - lab(m @ linear(b))))


def test_the_ruler() -> None:
    assert difference("#ffffff", "#000000", "all three") == pytest.approx(100, abs=0.1)
    assert lab(linear("#0072b2"))[0] == pytest.approx(46, abs=1)
    # pure red and a green of the same luminance: far apart for most, one and the same in grey
    assert difference("#ff0000", "#008000", "all three") > 100
    assert difference("#ff0000", "#008000", "grey") < 8


@pytest.mark.parametrize("sight", SIGHT)
@pytest.mark.parametrize("picture", TOGETHER)
def test_colours_of_one_picture_are_told_apart(picture: str, sight: str) -> None:
    for a, b in combinations(TOGETHER[picture], 2):
        assert difference(a, b, sight) > 6, (a, b)


@pytest.mark.parametrize("sight", SIGHT)
def test_chains_differ_in_colour_or_in_line(sight: str) -> None:
    for (a, line_a), (b, line_b) in combinations(style.CHAIN_STYLES, 2):
        assert line_a != line_b or difference(a, b, sight) > 20
    first, second = (color for color, _ in style.CHAIN_STYLES[:2])
    assert difference(first, second, sight) > 6


def test_bands_that_let_through_are_the_same_on_white() -> None:
    blue = np.array([int(style.BLUE[i : i + 2], 16) for i in (1, 3, 5)], dtype=float)

    def over(below: np.ndarray, alpha: float) -> np.ndarray:
        return (1 - alpha) * below + alpha * blue

    outer = over(np.full(3, 255.0), style.ALPHA_90)
    for seen, meant in ((outer, style.BAND_90), (over(outer, style.ALPHA_50), style.BAND_50)):
        assert np.abs(seen - [int(meant[i : i + 2], 16) for i in (1, 3, 5)]).max() < 6
    # over a grey bar the two bands are still two
    bar = np.array([int(style.BAR[i : i + 2], 16) for i in (1, 3, 5)], dtype=float)
    steps = [bar, over(bar, style.ALPHA_90), over(over(bar, style.ALPHA_90), style.ALPHA_50)]
    codes = ["#" + "".join(f"{round(c):02x}" for c in s) for s in steps]
    for sight in SIGHT:
        assert difference(codes[0], codes[1], sight) > 4
        assert difference(codes[1], codes[2], sight) > 4


def test_the_page_uses_the_colours_of_the_pictures() -> None:
    css = (TEMPLATES / "report.css").read_text(encoding="utf-8").lower()
    for key, color in (("band50", style.BAND_50), ("band90", style.BAND_90), ("bar", style.BAR)):
        assert re.search(rf"\.key\.{key} {{[^}}]*background: {color.lower()}", css), key
    assert f"--blue: {style.BLUE.lower()}" in css


def test_text_has_contrast() -> None:
    css = (TEMPLATES / "report.css").read_text(encoding="utf-8")
    names = dict(re.findall(r"--(\w+): (#\w+)", css))

    def luminance(color: str) -> float:
        color = "#" + "".join(2 * c for c in color[1:]) if len(color) == 4 else color
        return float(linear(color) @ [0.2126, 0.7152, 0.0722])

    for name in ("ink", "dim", "blue", "good"):  # WCAG 2.1 AA: 4.5 to 1
        assert 1.05 / (luminance(names[name]) + 0.05) > 4.5, name
