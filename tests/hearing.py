"""For processes that a test interrupts: a shell tells what it runs in its background to ignore Ctrl-C."""

import signal


def hears_ctrl_c() -> None:
    """As `preexec_fn` of a Popen."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
