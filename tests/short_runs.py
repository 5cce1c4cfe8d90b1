"""`bayes-dea` whose calibrations search and learn for a short time only.

Four fifths of a small calibration are the short runs that learn a proposal and the swarms that must agree. Tests that
ask how a run behaves (what it prints, leaves, resumes), not what it finds, do without most of them; every part of the
road is still taken. As a script this is the command line: `python tests/short_runs.py calibrate ...`; with NO_PAGE in
the environment it draws no page. In forked_runs.py, with SAMPLER_RESTS_S in the environment, the sampler rests so long
whenever it tells how far it is, to be interrupted there.
"""

import contextlib
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

from bayes_dea.commands.progress import Interrupted, signals


def short_settings(max_steps: int = 20_000, **settings):
    """CalibrationSettings with two swarms, and one short run of a hundred steps from which a Gaussian is learned."""
    from bayes_dea.find_map import MapSettings
    from bayes_dea.fit.adapt import AdaptSettings
    from bayes_dea.fit.ensemble import EnsembleSettings
    from bayes_dea.settings import CalibrationSettings

    short = {"map": replace(MapSettings(), swarms=2), "adapt": AdaptSettings(rounds=1, steps=100, components=(1,)),
             "sampler": EnsembleSettings(max_steps=max_steps)}
    return CalibrationSettings(**(short | settings))


def shorten(patch=setattr) -> None:
    """From here on, what is calibrated in this process with default settings is short: `shorten(monkeypatch.setattr)`.

    ELPDs that would need another sampling run stay unknown.
    """
    import bayes_dea.calibration

    patch(bayes_dea.calibration, "CalibrationSettings", short_settings)
    patch(bayes_dea.calibration, "_refit_left_out", lambda a, b, predictions, *rest: predictions)


def short_page(folder: Path, **_) -> Path:
    """A page that is not drawn: figures take half the time of a short run, and hold nothing that could be resumed."""
    from bayes_dea.results import write_text

    write_text(folder / "report.html", "<html>" + "<p>not drawn</p>" * 10_000 + "</html>")
    return folder / "report.html"


def without_page(patch=setattr) -> None:
    """From here on, `calibrate` writes `short_page`: `without_page(monkeypatch.setattr)`."""
    import bayes_dea.report.page

    patch(bayes_dea.report.page, "write_report", short_page)


def rest(seconds: float) -> None:
    """From here on, the sampler of `calibrate` rests so long whenever it tells how far it is."""
    import bayes_dea.commands.calibrate as verb

    plain = verb.progress

    @contextlib.contextmanager
    def progress(quiet):
        with plain(quiet) as report:

            def tell(phase, done, of, text):
                report(phase, done, of, text)
                if phase == "sampling" and text:
                    time.sleep(seconds)

            yield tell

    verb.progress = progress


if __name__ == "__main__":
    try:
        signals.install()  # as bayes_dea.__main__
        with signals.come_first():
            shorten()
            if "NO_PAGE" in os.environ:
                without_page()
            from bayes_dea.cli import main
    except Interrupted as stop:
        sys.exit(stop.exit_status)
    main()
