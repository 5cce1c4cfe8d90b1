"""What is remembered by which objects it is of."""

import gc

from bayes_dea.mismatch.search.once import Once


class Thing:
    """Something that has no value to compare by."""


def test_it_is_worked_out_once_for_the_same_objects_in_the_same_order():
    once, one, other, asked = Once(), Thing(), Thing(), []
    for of in ((one,), (one,), (one, other), (other, one), (one, other)):
        assert once(of, lambda of=of: asked.append(of) or len(of)) == len(of)
    assert asked == [(one,), (one, other), (other, one)]


def test_no_later_object_is_taken_for_one_that_is_gone():
    once = Once()
    for k in range(200):
        assert once((Thing(),), lambda k=k: k) == k
        gc.collect(0)
