"""TOML that tomllib takes or stumbles over, and no setting can be."""

import tomllib

import pytest

from bayes_dea.errors import InputError
from bayes_dea.experiments.costs import read_costs
from bayes_dea.toml_text import parse_toml


def test_what_is_well_is_what_tomllib_says():
    text = "a = 9223372036854775807\n[b]\nc = [[1, 2.5], {d = 'x'}]\n[[e]]\nf = true\n"
    assert parse_toml(text, "x.toml") == tomllib.loads(text)
    with pytest.raises(tomllib.TOMLDecodeError):
        parse_toml("a =", "x.toml")


@pytest.mark.parametrize(("text", "message"), [
    ("[a]\nb.c = 1" + 400 * "0", r"^x.toml: a.b.c is a whole number of more than 19 digits"),
    ("[[a]]\nb = 1\n[[a]]\nb = [1, 9223372036854775808]", r"^x.toml: a\[2\].b\[2\] is a whole number"),
    ("[a]\nb = -1" + 5000 * "0", r"^x.toml, line 2: b is a whole number"),
    ("a = 1\nb = " + 2000 * "[" + 2000 * "]", r"^x.toml: a value has brackets within brackets"),
    ("a = 1\nb = " + 100 * "[" + 100 * "]", r"^x.toml: b has brackets within brackets"),
])
def test_what_no_setting_can_be(text, message):
    with pytest.raises(InputError, match=message):
        parse_toml(text, "x.toml")


def test_costs(tmp_path):
    path = tmp_path / "cost.toml"
    path.write_text("setup_s = 1" + 400 * "0")
    with pytest.raises(InputError, match=r"^--costs .*cost.toml: setup_s is a whole number of more than 19 digits"):
        read_costs(path)
