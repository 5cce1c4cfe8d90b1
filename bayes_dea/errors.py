"""Errors that a user can act on.

Every message names the file, row or parameter, what is wrong with it and what to do.
"""


class BayesDEAError(Exception):
    """Base of everything this package raises on purpose; exit status 1."""

    exit_status = 1


class InputError(BayesDEAError):
    """What the user gave is wrong; exit status 2."""

    exit_status = 2


class NotConvergedWarning(UserWarning):
    """A sampler stopped at its limit before its stopping rule was met."""
