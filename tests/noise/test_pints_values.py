"""Noise models against values computed with PINTS 0.6.1 and scipy (to 1e-9)."""

import json

import numpy as np
import pytest

from bayes_dea.noise import densities as d


@pytest.fixture(scope="module")
def case(shared):
    folder = shared / "data" / "peers" / "pints_loglikelihood_values"
    values = json.loads((folder / "values.json").read_text())["cases"]
    _, y, f, clipped = np.loadtxt(folder / "data.csv", delimiter=",", skiprows=1).T
    calls = {
        "GaussianLogLikelihood": lambda p: d.gaussian(y - f, p["sigma"]),
        "StudentTLogLikelihood": lambda p: d.student_t(y - f, p["nu"], p["sigma"]),
        "CauchyLogLikelihood": lambda p: d.cauchy(y - f, p["sigma"]),
        "AR1LogLikelihood": lambda p: d.ar1(y - f, p["rho"], p["sigma"], exact=False),
        "AR1_exact_including_first_point": lambda p: d.ar1(y - f, p["rho"], p["sigma"]),
        "MultiplicativeGaussianLogLikelihood": lambda p: d.multiplicative(y, f, p["eta"], p["sigma"]),
        "ConstantAndMultiplicativeGaussianLogLikelihood":
            lambda p: d.constant_and_multiplicative(y, f, p["sigma_base"], p["eta"], p["sigma_rel"]),
        "CensoredGaussianLogLikelihood": lambda p: d.censored(clipped, f, p["sigma"], p["lower"], p["upper"]),
    }
    return values, calls


def test_every_value_of_the_file_is_checked(case):
    values, calls = case
    assert set(values) == set(calls)


@pytest.mark.parametrize("name", [
    "GaussianLogLikelihood", "StudentTLogLikelihood", "CauchyLogLikelihood", "AR1LogLikelihood",
    "AR1_exact_including_first_point", "MultiplicativeGaussianLogLikelihood",
    "ConstantAndMultiplicativeGaussianLogLikelihood", "CensoredGaussianLogLikelihood"])
def test_value(case, name):
    values, calls = case
    entry = values[name]
    ours = float(calls[name](entry["noise_parameters"]))
    assert abs(ours - entry["independent_scipy"]) < 1e-9
    if "pints_log_likelihood" in entry:
        assert abs(ours - entry["pints_log_likelihood"]) < 1e-9
