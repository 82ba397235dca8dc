"""Ctrl-C and termination, whatever exception they come as. Apart, as it is needed where nothing can be imported."""

from __future__ import annotations


def interruption_of(error: BaseException) -> KeyboardInterrupt | None:
    """The Ctrl-C or termination that came as this exception, if one did.

    Python 3.11 makes a RuntimeError of what interrupts the definition of a class, pybind11 an ImportError of what
    interrupts the import of its modules, and Numba a SystemError of what interrupts a kernel.
    """
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, KeyboardInterrupt):
        cause = cause.__cause__
    return cause
