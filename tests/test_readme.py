"""What the README and the READMEs of the runs show works as printed."""

import json
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
from pace import HANGS_S
from short_runs import shorten, without_page

from bayes_dea import cli

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.M | re.S)


@pytest.fixture
def beside_quickstart(tmp_path: Path, voltage_campaign: Path) -> Path:
    """What there is after the README's first command but its results: the priors of the checkout, a campaign called
    quickstart, small enough for a test."""
    shutil.copytree(voltage_campaign, tmp_path / "quickstart")
    (tmp_path / "priors").symlink_to(ROOT / "priors")
    return tmp_path


@pytest.fixture
def run(beside_quickstart: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """`run(line)`: a line of the README in that folder, in this process; what it calibrates is short."""
    shorten(monkeypatch.setattr)
    monkeypatch.chdir(beside_quickstart)
    monkeypatch.setenv("TERM", "dumb")  # else the command sets it

    def run(line: str, *more: str) -> None:
        program, *words = shlex.split(line)
        assert program == "bayes-dea"
        words = [f for w in words for f in (sorted(map(str, Path().glob(w))) if "*" in w else [w])]
        monkeypatch.setattr(sys, "argv", [program, *words, *more, "--quiet"])
        assert cli._run() == 0, line

    return run


def test_commands_with_priors_run(beside_quickstart: Path, run: Callable[..., None], monkeypatch: pytest.MonkeyPatch):
    commands = re.findall(r"^    (bayes-dea calibrate .*)$", README, re.M)
    assert len(commands) == 2
    without_page(monkeypatch.setattr)
    for line in commands:
        run(line, "--max-steps", "200")


def test_command_that_redoes_the_paper_runs(run: Callable[..., None]):
    """One part of it, for the time."""
    (line,) = re.findall(r"^    (bayes-dea paper .*)$", README, re.M)
    run(line, "--sections", "misprints")
    assert len(json.loads(Path("paper/paper.json").read_text(encoding="utf-8"))["entries"]) == 35
    assert Path("paper/report.html").is_file()


def test_command_that_compares_runs(run: Callable[..., None]):
    """With fewer structures than printed, for the time."""
    (line,) = re.findall(r"^    (bayes-dea compare .*)$", README, re.M)
    run(re.sub(r"--models \S+", "--models hooke,hooke+gm1..2", line))
    assert Path("comparison/comparison.json").is_file()


def test_commands_on_a_calibration_run(beside_quickstart: Path, run: Callable[..., None]):
    """What the first command calibrates, and then the lines on it, on files and of the bench as printed, in order.

    With one branch instead of three, for the time.
    """
    (first,) = re.findall(r"bayes-dea calibrate quickstart [^&\n]*--out [^&\n ]+", blocks("sh")[0])
    run(first.replace("hooke+gm3", "hooke+gm1"), "--max-steps", "200")
    lines = re.findall(r"^    ((?:bayes-dea (?:predict|export|report|import|bench|next)|python) [^\n]*[^&\n])$", README,
                       re.M)
    assert {line.split()[1] for line in lines} == {"predict", "export", "report", "import", "bench", "next", "-c"}
    for line in lines:
        if line.startswith("python "):
            subprocess.run(line.replace("python", shlex.quote(sys.executable), 1), shell=True, check=True)
        else:
            run(line)
    for made in ("check/prediction.csv", "follow/command.csv", "out/quickstart/model.mat", "imported/campaign.toml",
                 "with_resistor/campaign.toml", "next/next/costs.toml"):
        assert (beside_quickstart / made).is_file(), made


def test_campaign_blocks_are_what_the_reader_takes(tmp_path: Path):
    import numpy as np

    import bayes_dea as bd

    campaign, form = (b for b in blocks("toml") if not b.startswith("[device]"))
    recording = tomllib.loads(campaign)["recording"][0]
    assert set(tomllib.loads(form)["format"]) == {"delimiter", "decimal", "encoding", "skip_rows", "columns"}
    t = np.arange(200) * 0.01
    V = np.where(t > 0.5, 600.0, 0.0)
    x = V**2 * 7e-11
    lines = ["bench 3", "Time (s);HV monitor;Laser"]
    lines += [f"{a:.2f};{b / 1e3:.4f};{1.5 - c * 1e3:.6f}".replace(".", ",") for a, b, c in zip(t, V, x, strict=True)]
    (tmp_path / recording["file"]).write_text("\n".join(lines) + "\n", encoding="latin-1")
    (tmp_path / "campaign.toml").write_text(campaign + form, encoding="utf-8")
    read = bd.load_campaign(tmp_path).recordings[0]
    np.testing.assert_allclose(read.columns["voltage_V"], V)
    np.testing.assert_allclose(read.columns["displacement_m"], x, atol=1e-9)


def test_models_that_the_readme_names_exist():
    import bayes_dea as bd

    table = README.split("## Models")[1].split("## A campaign")[0]
    named = set(re.findall(r"`([a-z0-9+]+)`", table))
    for text in named - {"hooke+gmN", "hooke+gkvN"}:
        if re.fullmatch(r"(gm|gkv|gkm)\d", text):
            text = f"hooke+{text}"
        if "N" not in text:
            assert bd.build_model(text).name
    assert {"hooke", "neohooke", "yeoh", "ogden", "mooney", "gent", "pz3", "ss3"} <= named


@pytest.mark.parametrize("name", ["quickstart", "vhb4910", "hasel"])
def test_every_run_has_a_readme_with_a_command(name: str):
    text = (ROOT / "runs" / name / "README.md").read_text(encoding="utf-8")
    assert "bayes-dea calibrate" in text


def test_files_that_the_readme_points_to_exist():
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", README):
        assert (ROOT / target).exists(), target


def test_live_commands_run(beside_quickstart: Path):
    """Both lines as printed, but for a shorter programme and a clock that runs faster."""
    bench, live = re.findall(r"^    (bayes-dea bench --serve-pty .*) &\n    (.*)$", README, re.M)[0]
    assert "--play demo" in live
    here = f"{shlex.quote(sys.executable)} -m bayes_dea"
    bench = bench.replace("bayes-dea", here).replace("--lasting 90", "--lasting 40 --speed 4")
    live = live.replace("bayes-dea", here).replace("--play demo", "--play short").replace("hooke+gm3", "hooke+gm1")
    device = subprocess.Popen(shlex.split(bench), cwd=beside_quickstart, stdout=subprocess.DEVNULL)
    try:
        done = subprocess.run(live + " --quiet", shell=True, cwd=beside_quickstart, capture_output=True, text=True,
                              timeout=HANGS_S, check=False)
    finally:
        device.terminate()
        device.wait(timeout=HANGS_S)
    assert done.returncode == 0, done.stderr
    assert json.loads((beside_quickstart / "live" / "live.json").read_text(encoding="utf-8"))["samples"] > 1000
