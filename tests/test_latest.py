"""The last few results of work that is asked for again and again."""

from bayes_dea.latest import Latest


def test_work_is_done_once_for_a_key_and_what_stands_beside_it():
    latest, done = Latest(kept=2), []

    def work(name):
        done.append(name)
        return name

    one, other = [0], [0]  # equal, and not the same
    assert latest("a", one, lambda: work("a one")) == "a one"
    assert latest("a", one, lambda: work("again")) == "a one"
    assert latest("a", other, lambda: work("a other")) == "a other"
    assert latest("a", one, lambda: work("again")) == "a one"
    assert done == ["a one", "a other"]


def test_what_was_asked_for_last_stays():
    latest, done = Latest(kept=2), []
    for key in ("a", "b", "a", "c", "a", "b"):
        latest(key, None, lambda key=key: done.append(key))
    # b was the one not asked for lately when c came, and c when b came again
    assert done == ["a", "b", "c", "b"]
