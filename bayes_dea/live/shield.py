"""Signals that arrive in the middle of an update wait until it is whole."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType


@contextlib.contextmanager
def shielded() -> Iterator[None]:
    """SIGINT and SIGTERM that arrive inside are delivered, in their order, after it.

    A block of samples that has left the queue and is not yet in the posterior would be lost to the results otherwise.
    For short work only (an update, well under a second). Outside the main thread, where no signal is handled, it does
    nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    arrived: list[int] = []

    def later(number: int, _frame: FrameType | None) -> None:
        arrived.append(number)

    # a handler that was not set from Python (None) could not be put back; one that is ignored stays ignored
    before = {n: h for n in (signal.SIGINT, signal.SIGTERM)
              if (h := signal.getsignal(n)) not in (None, signal.SIG_IGN)}
    try:
        for each in before:
            signal.signal(each, later)
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
        for came in arrived:
            signal.raise_signal(came)
