"""SPEC texts: what they mean, and what is said about those that mean nothing."""

import pytest

from bayes_dea.errors import InputError
from bayes_dea.models.spec import Spec, parse_spec

LAWS = ("hooke", "neohooke", "yeoh", "mooney", "gent", "ogden")


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("network", ["gm", "gkv", "gkm"])
@pytest.mark.parametrize("n", [1, 6])
def test_every_law_with_every_network(law, network, n):
    spec = parse_spec(f"{law}+{network}{n}")
    assert spec == Spec(law, network, n)
    assert spec.name == f"{law}+{network}{n}"
    assert parse_spec(spec.name) == spec


def test_order_case_and_blanks_do_not_matter():
    assert parse_spec(" GM3 + Hooke ") == parse_spec("hooke+gm3")


def test_a_law_alone_is_elastic():
    assert parse_spec("yeoh") == Spec("yeoh", "none", 0)
    assert parse_spec("yeoh").name == "yeoh"


@pytest.mark.parametrize("name", ["pz3", "ss3"])
def test_black_boxes(name):
    assert parse_spec(name) == Spec(None, name, 3)
    assert parse_spec(name).name == name


@pytest.mark.parametrize(("text", "message"), [
    ("hoke+gm3", r"'hoke' is unknown; did you mean 'hooke'\?"),
    ("hooke+gn3", r"'gn3' is unknown; did you mean 'g"),
    ("hooke+qqqqq", r"'qqqqq' is unknown. A model is a static law \(hooke, .*\) \+ gmN"),
    ("hooke+yeoh+gm3", "two static laws, 'hooke' and 'yeoh'"),
    ("hooke+gm3+gkv2", "two networks"),
    ("hooke+gm7", "gm7 has 7 elements; 1 to 6 are possible"),
    ("hooke+gm0", "gm0 has 0 elements"),
    ("gm3", r"a network needs a static law as its spring; write 'hooke\+gm3'"),
    ("hooke+pz3", "driven by the static Hooke strain already; write 'pz3'"),
    ("pz3+ss3", "ss3 is a whole model and takes no other network"),
    ("hooke+gm3+", "'' is unknown"),
    ("", "'' is unknown"),
])
def test_what_means_nothing(text, message):
    with pytest.raises(InputError, match=message):
        parse_spec(text)
