"""Signals during an update of a live run."""

import os
import signal
import threading
import time

import pytest

from bayes_dea.live.shield import shielded


class Arrived(BaseException):
    pass


@pytest.fixture(params=[signal.SIGINT, signal.SIGTERM])
def number(request):
    def raises(_number, _frame):
        raise Arrived

    before = signal.signal(request.param, raises)
    yield request.param
    signal.signal(request.param, before)


def killed(number):
    os.kill(os.getpid(), number)
    time.sleep(0.01)


def shielded_work(number, done):
    with shielded():
        killed(number)
        done.append("work")


def wrong_work():
    with shielded():
        raise ValueError("of the work")


def test_a_signal_inside_comes_after_the_work(number):
    done = []
    with pytest.raises(Arrived):
        shielded_work(number, done)
    assert done == ["work"]
    with pytest.raises(Arrived):  # and outside it comes at once again
        killed(number)


def test_an_error_of_the_work_does_not_lose_the_handler(number):
    with pytest.raises(ValueError, match="of the work"):
        wrong_work()
    with pytest.raises(Arrived):
        killed(number)


def test_what_is_ignored_stays_ignored():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with shielded():
            killed(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_in_a_thread_it_does_nothing():
    handler, seen = signal.getsignal(signal.SIGINT), []

    def work():
        with shielded():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [handler]
