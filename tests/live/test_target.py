"""Which earlier posterior a live run may begin with."""

import numpy as np
import pytest
import xarray as xr
from stream import ACTUATOR, TOML

from bayes_dea.campaign import recording_from_arrays
from bayes_dea.errors import InputError
from bayes_dea.fit.diagnostics import arviz
from bayes_dea.forward import simulate
from bayes_dea.live.run import LiveSettings, follow_bench
from bayes_dea.live.target import check_start
from bayes_dea.models.model import build_model
from bayes_dea.store import netcdf_bytes


def kept(folder, spec, n=50):
    """posterior.nc of prior draws (n, d) of a structure, with the coordinate of a noise behind them."""
    model = build_model(spec)
    draws = model.prior_draws(n, np.random.default_rng(1))
    names = [*model.coordinate_names, "log sigma_displacement"]
    data = xr.Dataset({"coordinates": (("chain", "draw", "coordinate"), np.pad(draws, ((0, 0), (0, 1)))[None])},
                      coords={"coordinate": names}).assign_attrs({"model": model.name})
    folder.mkdir(exist_ok=True)
    (folder / "posterior.nc").write_bytes(netcdf_bytes(arviz().InferenceData(posterior=data)))
    return draws


@pytest.mark.parametrize(("spec", "earlier"), [
    ("hooke+gm2", "hooke+gm3"),  # whose coordinates are all among the other's
    ("hooke+gm1", "hooke+gm1+acquisition_delay"),
    ("hooke+gm2", "neohooke+gm2"),  # whose coordinates have the same names
    ("hooke+gm3", "hooke+gm2"),
    ("hooke+gm1+parallel_damper", "hooke+gkm1"),  # one function, in other coordinates
])  # fmt: skip
def test_a_posterior_of_another_structure_is_no_prior(tmp_path, spec, earlier):
    kept(tmp_path, earlier)
    with pytest.raises(InputError) as refused:
        check_start(build_model(spec), tmp_path)
    assert f"of {earlier} " in str(refused.value) or f"of {earlier}," in str(refused.value)
    assert str(refused.value).endswith(f"a calibration of {spec}")


@pytest.mark.parametrize(("spec", "earlier"), [
    ("hooke+gm2", "hooke+gm2"), ("hooke+gm2", "hooke+gkv2"), ("ss3", "pz3"),
    ("hooke+gkv1+series_resistance", "hooke+gm1+series_resistance"),
])  # fmt: skip
def test_another_name_of_the_same_function_is_one(tmp_path, spec, earlier):
    draws = kept(tmp_path, earlier)
    own, other = build_model(spec), build_model(earlier)
    z = check_start(own, tmp_path / "posterior.nc")
    np.testing.assert_array_equal(z, draws)
    t = 0.02 * np.arange(200)
    r = recording_from_arrays("step", "voltage", {"time_s": t, "voltage_V": np.where(t > 0.5, 800.0, 0.0),
                                                  "displacement_m": np.zeros(t.size)}, actuator=ACTUATOR)
    for i in range(3):  # coordinates that say the same of both
        one, two = (simulate(m, {k: float(v[0]) for k, v in m.physical(z[[i]]).items()}, r) for m in (own, other))
        np.testing.assert_allclose(one, two, rtol=1e-9, atol=1e-15)


def test_it_is_refused_before_the_bench_is_touched(tmp_path):
    (tmp_path / "campaign.toml").write_text(TOML)
    kept(tmp_path / "first", "hooke+gm2")
    with pytest.raises(InputError, match=r"of hooke\+gm2, another function; start from a calibration of hooke\+gm1"):
        follow_bench("loop://", tmp_path, "hooke+gm1", tmp_path / "out",
                     settings=LiveSettings(start=tmp_path / "first"))
    assert not (tmp_path / "out").exists()
