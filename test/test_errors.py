# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Every error of the package survives a process pool: it can be pickled with all that it holds."""

import copy
import importlib
import inspect
import pickle
import pkgutil
from collections.abc import Iterator
from typing import Any

import pytest

import linkage_vibration
from linkage_vibration.errors import LinkageVibrationError, printable
from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.mechanics.kinematics import KinematicsError, Toggle

for module in pkgutil.walk_packages(linkage_vibration.__path__, "linkage_vibration."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)


def test_foreign_text_stays_in_its_line() -> None:
    """Line breaks and control characters are shown as `repr` shows them, in errors too."""
    text = "boom\n[ERROR]\r\x1b[2J\u2028 übrig"
    shown = r"boom\n[ERROR]\r\x1b[2J\u2028 übrig"
    assert (printable(text), str(LinkageVibrationError(text))) == (shown, shown)
    assert repr(text) == f"'{shown}'"


def _subclasses(kind: type[LinkageVibrationError]) -> Iterator[type[LinkageVibrationError]]:
    yield kind
    for child in kind.__subclasses__():
        yield from _subclasses(child)


ERRORS = sorted(set(_subclasses(LinkageVibrationError)), key=lambda kind: kind.__qualname__)
TOGGLE = Toggle(3.2, ("P1", "P2"), ("link",))


def _arguments(kind: type[LinkageVibrationError]) -> list[Any]:
    """Return arguments for an error: text, or a value of its own for each parameter."""
    if kind is KinematicsError:
        return [4.0, TOGGLE]
    if "__init__" not in vars(kind):
        return ["The file is missing; give another."]
    return [f"value of {name}" for name in [*inspect.signature(kind).parameters]]


@pytest.mark.parametrize("kind", ERRORS, ids=lambda kind: kind.__name__)
def test_every_error_can_be_pickled(kind: type[LinkageVibrationError]) -> None:
    """An error keeps its class, its text and its attributes."""
    error = kind(*_arguments(kind))
    error.add_note("a note")
    for each in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(each) is kind
        assert str(each) == str(error) != ""
        assert each.args == error.args
        assert vars(each) == vars(error)


def test_all_errors_are_found() -> None:
    """The list above holds the errors of every room."""
    assert len(ERRORS) >= 35
    assert {MechanismError, KinematicsError} < set(ERRORS)
    assert pickle.loads(pickle.dumps(KinematicsError(4.0, TOGGLE))).nearest == TOGGLE
