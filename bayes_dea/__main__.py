"""`bayes-dea` and `python -m bayes_dea`: signals are caught before the other imports begin."""

from __future__ import annotations

import sys

from .commands.progress import Interrupted, signals


def main() -> None:
    """Entry point; see `cli.main`."""
    try:
        signals.install()  # a Ctrl-C while the rest is imported ends without a traceback, too
        with signals.come_first():
            from .cli import main as run
    except Interrupted as stop:
        sys.exit(stop.exit_status)
    run()


if __name__ == "__main__":
    main()
