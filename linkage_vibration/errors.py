# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The base class of every error that this package raises on purpose."""

from copyreg import __newobj__  # type: ignore[attr-defined]
from typing import Any


def printable(text: str) -> str:
    """Return foreign text, whose line breaks and control characters are those of `repr`.

    Otherwise the name of a joint or of a topic could look like a line of a log.
    """
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


class LinkageVibrationError(Exception):
    """The text says in one sentence what is wrong, where, and what to do about it.

    Command lines and nodes catch this class and print its text; any other exception is a defect.
    Every subclass can be pickled, whatever its constructor takes, and so can leave a process pool.
    """

    def __str__(self) -> str:
        """Return the text, of which parts may come from messages and files."""
        return printable(super().__str__())

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the function that rebuilds this error, and what it needs."""
        return __newobj__, (type(self), *self.args), vars(self)


def check_type(value: object, hint: str, *kinds: type) -> None:
    """Refuse a value of none of some types, with a hint that says how to get one."""
    if not isinstance(value, kinds):
        names = " or ".join(kind.__name__ for kind in kinds)
        given = type(value).__name__
        raise LinkageVibrationError(f"The type {given} is given in place of {names}; {hint}.")
