"""Compiled code is kept from run to run, and forgotten when anything changes that it was compiled from."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import bayes_dea
from bayes_dea.compiled import read_only, sources, writeable
from bayes_dea.models.mechanics import strain_driven, stress_driven
from bayes_dea.models.strain_kernel import strain_driven_kernel
from bayes_dea.models.stress_kernel import stress_driven_kernel

PACKAGE = Path(bayes_dea.__file__).parent
KERNEL = """
from bayes_dea.compiled import njit

from .inner import inner
from .sizes import SIZE


@njit(cache=True)
def outer(x):
    return inner(x) + SIZE
"""
INNER = """
from bayes_dea.compiled import njit


@njit(cache=True)
def inner(x):
    return {}
"""
SAY = "from kernels.outer import outer; print(outer(1.0), len(outer.stats.cache_hits), len(outer.stats.cache_misses))"


@pytest.fixture
def kernels(tmp_path):
    """A package of two kernels and a constant, and what a process says that calls them."""
    package = tmp_path / "kernels"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "outer.py").write_text(KERNEL)
    (package / "inner.py").write_text(INNER.format("2.0 * x"))
    (package / "sizes.py").write_text("SIZE = 10.0\n")

    def says():
        got = subprocess.run([sys.executable, "-c", SAY], cwd=tmp_path, capture_output=True, text=True, check=True)
        value, hits, misses = got.stdout.split()
        return float(value), int(hits), int(misses)

    return package, says


def test_it_is_kept_until_what_it_calls_or_a_constant_changes(kernels):
    package, says = kernels
    assert says() == (12.0, 0, 1)
    assert says() == (12.0, 1, 0)
    (package / "inner.py").write_text(INNER.format("3.0 * x"))
    assert says() == (13.0, 0, 1)
    assert says() == (13.0, 1, 0)
    (package / "sizes.py").write_text("SIZE = 20.0\n")
    assert says() == (23.0, 0, 1)
    (package / "beside.py").write_text("SIZE = 30.0\n")
    assert says() == (23.0, 1, 0)


def test_a_file_is_made_of_what_it_imports_directly_or_not():
    got = {p.relative_to(PACKAGE).as_posix() for p in sources(PACKAGE / "models" / "plants_kernel.py")}
    # plants call the chain, the chain its material, the material the laws
    assert {"models/plants_kernel.py", "models/plant_kernel.py", "models/material_kernel.py", "models/static.py"} <= got
    # and of nothing else
    assert all(name.startswith("models/") or name in ("compiled.py", "errors.py") for name in got)
    assert not {"models/model.py", "models/plant.py", "models/plate_kernel.py"} & got


def test_imports_are_read_however_they_are_written(tmp_path):
    package = tmp_path / "forms"
    (package / "deep").mkdir(parents=True)
    for name in ("__init__", "a", "b", "c", "d", "e", "f", "deep/__init__", "deep/g"):
        (package / f"{name}.py").write_text("")
    (package / "deep" / "whole.py").write_text(
        "import math\nimport forms.a\nfrom forms.b import x\nfrom .. import c\nfrom ..d import (\n    y,\n    z,\n)\n"
        "from ..nothing import q\n\n\ndef late():\n    from .g import w\n    return w\n")
    got = {p.relative_to(package).as_posix() for p in sources(package / "deep" / "whole.py")}
    assert {"deep/whole.py", "a.py", "b.py", "c.py", "d.py", "deep/g.py"} <= got
    assert not {"e.py", "f.py"} & got


def test_every_kernel_is_compiled_by_it():
    own = PACKAGE / "compiled.py"
    for path in PACKAGE.rglob("*.py"):
        if path != own:
            assert not re.search(r"from numba import[^\n]*\bn?jit\b|numba\.n?jit|import numba\b",
                                 path.read_text(encoding="utf-8")), path


def arrays():
    """The same numbers as whoever calls may have them."""
    plain = np.linspace(1.0, 2.0, 40)
    frozen = plain.copy()
    frozen.flags.writeable = False
    return [plain, frozen, np.stack([plain, plain], axis=1)[:, 0], plain.tolist()]


@pytest.mark.parametrize("given", arrays(), ids=["plain", "read-only", "strided", "list"])
def test_what_kernels_are_given_is_of_one_kind(given):
    for made, may in ((read_only(given), False), (writeable(given), True)):
        assert made.flags.c_contiguous
        assert made.flags.writeable == may
        np.testing.assert_array_equal(made, np.asarray(given))
    if isinstance(given, np.ndarray):
        was = given.flags.writeable
        assert np.shares_memory(read_only(given), given) == given.flags.c_contiguous
        assert given.flags.writeable == was


def test_a_large_kernel_is_compiled_once_whatever_arrays_it_is_called_with():
    known = []
    for given in arrays():
        stress_driven("hooke", [1e6], "gm", [1e5], [3.0], 0.0, given, np.asarray(given))
        strain_driven("hooke", [1e6], "gm", [1e5], [3.0], 0.0, np.asarray(given)[1:], given)
        known.append((set(stress_driven_kernel.signatures), set(strain_driven_kernel.signatures)))
    assert all(known[0])
    assert known == known[:1] * len(known)
