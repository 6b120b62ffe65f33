# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of code are those without docstrings, comments and blank lines."""

from tools.count_lines import count

MODULE = '''\
"""The docstring of the module."""

# a comment
LIMIT = 1.0  # code, although it has a comment
"""The docstring of a constant, as Sphinx
and numpydoc see it."""


class Part:
    """The docstring of a class."""

    size: int = 3
    """The docstring of an attribute."""

    def text(self):
        """The docstring of a method."""
        return "a text"  # code


print(LIMIT)
"""a string that documents nothing"""
'''


def test_docstrings_of_constants_and_attributes_are_no_code() -> None:
    """Lines 4, 9, 12, 15, 17, 20 and 21 are code; the last one is a string behind a call."""
    assert count(MODULE) == (21, 7)
