"""Fixtures shared by all tests."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

SHORT_RUNS = Path(__file__).with_name("short_runs.py")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """With -n each worker begins with a half of the tests in their order and takes over from the other when it is done.

    So the tests of a file share its fixtures, which the usual dealing out in turn makes once in every worker.
    """
    if config.getoption("dist") != "load":
        return None  # another order was asked for
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log)  # type: ignore[arg-type]


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of reference data beside the project; tests that need it skip on a user's machine."""
    folder = Path(__file__).resolve().parents[2] / "shared"
    if not folder.is_dir():
        pytest.skip(f"reference data folder {folder.name}/ is not beside the project")
    return folder


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[Path], object]], Path]:
    """Maker of folders that are filled once for all workers of a test run: `once(name, fill)`."""
    base = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent

    def get(name: str, fill: Callable[[Path], object]) -> Path:
        done, claim = base / name, base / f"{name}.claim"
        try:
            claim.mkdir()
        except FileExistsError:
            for _ in range(6000):
                if done.exists():
                    return done
                if (claim / "failed").exists():
                    pytest.fail(f"{name} could not be made by another worker: {(claim / 'failed').read_text()}")
                time.sleep(0.05)
            pytest.fail(f"{name} was not made by another worker within 300 s")
        filling = claim / "filling"
        try:
            fill(filling)
        except BaseException as error:
            (claim / "failed").write_text(repr(error))
            raise
        filling.rename(done)
        return done

    return get


@pytest.fixture(scope="session")
def command() -> Callable[..., subprocess.CompletedProcess[str]]:
    """`bayes-dea ARGUMENTS` in a process of its own, its output captured; `short=True`: see short_runs.py."""

    def run(*arguments: object, timeout: float = 300.0, short: bool = False, **options: object
            ) -> subprocess.CompletedProcess[str]:
        program = [str(SHORT_RUNS)] if short else ["-m", "bayes_dea"]
        return subprocess.run([sys.executable, *program, *map(str, arguments)], capture_output=True,  # type: ignore[call-overload, no-any-return]
                              text=True, timeout=timeout, check=False, **options)

    return run


@pytest.fixture(scope="session")
def small_campaign(once: Callable[..., Path]) -> Path:
    """The preset `small` of the virtual bench: voltage and mechanical recordings, a few seconds each."""
    from bayes_dea.bench.run import run_bench

    return once("small", lambda folder: run_bench(folder, "small", seed=1))


@pytest.fixture(scope="session")
def voltage_campaign(small_campaign: Path, once: Callable[..., Path]) -> Path:
    """The voltage recordings of `small_campaign` alone."""

    def fill(folder: Path) -> None:
        shutil.copytree(small_campaign, folder)
        toml = folder / "campaign.toml"
        parts = re.split(r"(?=\[\[recording\]\])|(?=\[meta\])", toml.read_text(encoding="utf-8"))
        toml.write_text("".join(p for p in parts if "compression" not in p and "relaxation" not in p), encoding="utf-8")

    return once("voltage", fill)


@pytest.fixture
def without_refits(monkeypatch: pytest.MonkeyPatch) -> None:
    """ELPDs that would need another sampling run stay unknown: half the time of a short calibration."""
    monkeypatch.setattr("bayes_dea.calibration._refit_left_out", lambda a, b, predictions, *rest: predictions)


def result(folder: Path, stdout: str, stderr: str) -> SimpleNamespace:
    """A calibration's folder with what is in calibration.json and what was printed."""
    def refuse(token: str) -> float:
        raise ValueError(f"{token} is not JSON")

    text = (folder / "calibration.json").read_text(encoding="utf-8")
    return SimpleNamespace(folder=folder, summary=json.loads(text, parse_constant=refuse), stdout=stdout, stderr=stderr)


@pytest.fixture(scope="session")
def calibrated(once: Callable[..., Path], command: Callable[..., subprocess.CompletedProcess[str]]
               ) -> Callable[..., SimpleNamespace]:
    """Calibration by the command line, kept for all tests: `calibrated(campaign, model, *options, short=False)`."""

    def get(campaign: Path, model: str, *options: object, short: bool = False) -> SimpleNamespace:
        words = ("short" if short else "out", campaign.name, model, *options)
        name = "-".join(re.sub(r"\W", "_", str(x)) for x in words)

        def fill(folder: Path) -> None:
            done = command("calibrate", campaign, "--model", model, "--out", folder, *options, short=short)
            assert done.returncode == 0, done.stderr
            (folder / "stdout.txt").write_text(done.stdout, encoding="utf-8")
            (folder / "stderr.txt").write_text(done.stderr, encoding="utf-8")

        folder = once(name, fill)
        return result(folder, *((folder / f).read_text(encoding="utf-8") for f in ("stdout.txt", "stderr.txt")))

    return get


@pytest.fixture(scope="session")
def converged(voltage_campaign: Path, calibrated: Callable[..., SimpleNamespace]) -> SimpleNamespace:
    """hooke+gm1 on the voltage recordings, sampled until it converged."""
    return calibrated(voltage_campaign, "hooke+gm1", "--workers", 1)


@pytest.fixture(scope="session")
def unconverged(small_campaign: Path, calibrated: Callable[..., SimpleNamespace]) -> SimpleNamespace:
    """hooke+gm2 on voltage and mechanical recordings, stopped long before it converged."""
    return calibrated(small_campaign, "hooke+gm2", "--max-steps", 200, short=True)
