# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads a mapping key by key; the first invalid key raises an error that names its path."""

import difflib
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from linkage_vibration.mechanics.description import MechanismError, Point

_LARGEST = 1e30  # SI; powers of larger numbers overflow

STIFFEST, DAMPEST = 1e15, 1e12
"""Stiffness and damping, SI, beside which links lose more than 1e-6 by rounding."""
RIGID = "give SI units, or join the bodies rigidly instead"
"""What to do about a stiffness or a damping beyond these."""


class CheckedMapping:
    """A mapping with its path, such as ``links.crank``; reading an invalid key is an error."""

    def __init__(self, path: str, value: Any) -> None:
        where = path or "(top)"
        if not isinstance(value, Mapping):
            raise MechanismError(where, f"{value!r} is not a mapping of keys to values.")
        for key in value:
            if not isinstance(key, str):
                raise MechanismError(where, f"the key {key!r} is not text; put it in quotes.")
            if not key.isprintable() or not key.strip():
                problem = f"the key {key!r} cannot be read in a sentence; give another name."
                raise MechanismError(where, problem)
        self.path = path
        self._value = value
        self._children: dict[str, CheckedMapping] = {}
        self._read: set[str] = set()

    def __iter__(self) -> Iterator[str]:
        """Return the keys, in their order."""
        return iter(self._value)

    def __contains__(self, key: str) -> bool:
        """Return whether a key exists."""
        return key in self._value

    def __getitem__(self, key: str) -> "CheckedMapping":
        """Return the mapping of a key."""
        return self._child(key, self._get(key))

    def error(self, key: str, problem: str) -> MechanismError:
        """Return the error that a key is invalid, to be raised; the problem includes the fix."""
        return MechanismError(self._at(key), problem)

    def names(self, key: str) -> list[str]:
        """Return the keys of the mapping of a key, which is optional."""
        return list(self[key]) if key in self else []

    def items(self, key: str) -> "list[CheckedMapping]":
        """Return the mappings in the list of a key."""
        value = self._get(key)
        if not isinstance(value, list) or not value:
            raise self.error(key, f"{value!r} is not a list of mappings.")
        return [self._child(f"{key}[{i}]", item) for i, item in enumerate(value)]

    def is_mapping(self, key: str) -> bool:
        """Return whether the value of a key is a mapping."""
        return isinstance(self._value.get(key), Mapping)

    def is_list(self, key: str) -> bool:
        """Return whether the value of a key is a list."""
        return isinstance(self._value.get(key), list)

    def number(
        self,
        key: str,
        *,
        positive: bool = False,
        default: float | None = None,
        least: float = -_LARGEST,
        most: float = _LARGEST,
        hint: str = "",
    ) -> float:
        """Return a finite number from `least` to `most`; the hint ends the error."""
        if default is not None and key not in self:
            return default
        value = self._finite(key, self._get(key))
        if positive and value <= 0.0:
            raise self.error(key, f"{value:g} is not greater than zero.")
        self.refuse_outside(key, value, least, most, hint)
        return value

    def refuse_outside(self, key: str, value: float, least: float, most: float, hint: str) -> None:
        """Refuse a number that is not from `least` to `most`; the hint ends the error."""
        if not least <= value <= most:
            limit = f"below {least:g}" if value < least else f"above {most:g}"
            raise self.error(key, f"{value:g} is {limit}; {hint}.")

    def numbers(self, key: str) -> list[float]:
        """Return a list of finite numbers, at least one."""
        return self._numbers(key, "a list of numbers, such as [1, 2]")

    def integer(self, key: str, *, default: int | None = None, least: int = 1) -> int:
        """Return a whole number from `least` to 10000."""
        value = self._get(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= 10_000:
            raise self.error(key, f"{value!r} is not a whole number from {least} to 10000.")
        return value

    def flag(self, key: str) -> bool:
        """Return true or false; false if the key is missing."""
        value = self._get(key, False)
        if not isinstance(value, bool):
            raise self.error(key, f"{value!r} is neither true nor false.")
        return value

    def text(self, key: str) -> str:
        """Return text that is not empty."""
        value = self._get(key)
        if not isinstance(value, str) or not value:
            raise self.error(key, f"{value!r} is not text.")
        if not value.isprintable():
            raise self.error(key, f"{value!r} cannot be read in a sentence; give another text.")
        return value

    def words(self, key: str) -> tuple[str, ...]:
        """Return a list of texts."""
        value = self._get(key)
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise self.error(key, f"{value!r} is not a list of names.")
        return tuple(value)

    def choice(self, key: str, allowed: Collection[str], *, default: str | None = None) -> str:
        """Return one of the texts allowed."""
        value = self._get(key, default)
        if not isinstance(value, str) or value not in allowed:
            raise self.error(key, f"{value!r} is not one of: {', '.join(allowed)}.")
        return value

    def place(self, key: str) -> Point:
        """Return a place on a link: a number along its axis, or [x, z] beside it."""
        if isinstance(self._value.get(key), list | tuple):
            return self.point(key)
        return (self.number(key), 0.0)

    def point(self, key: str) -> Point:
        """Return a pair of coordinates."""
        return self._pair(key, "a point [x, z] in m")

    def pair(self, key: str) -> tuple[float, float]:
        """Return two numbers, one for each of the directions x and z."""
        return self._pair(key, "two numbers [along x, along z]")

    def interval(self, key: str, *, positive: bool = False) -> tuple[float, float]:
        """Return an ascending pair of numbers."""
        low, high = self._pair(key, "an interval [from, to]")
        if high <= low or (positive and low <= 0.0):
            above = " from above zero" if positive else ""
            raise self.error(key, f"[{low:g}, {high:g}] does not ascend{above}; give [from, to].")
        return low, high

    def refuse_unknown(self) -> None:
        """Refuse keys that nothing has read: a misspelt key must not be ignored silently."""
        for child in self._children.values():
            child.refuse_unknown()
        for key in self._value:
            if key not in self._read:
                near = difflib.get_close_matches(key, self._read, 1)
                advice = f"did you mean {near[0]}?" if near else "remove it."
                raise self.error(key, f"this key is not known here; {advice}")

    def _child(self, key: str, value: Any) -> "CheckedMapping":
        """Return the mapping at a key or in a list, the same each time."""
        if key not in self._children:
            self._children[key] = CheckedMapping(self._at(key), value)
        return self._children[key]

    def _at(self, key: str) -> str:
        return f"{self.path}.{key}" if self.path else key

    def _get(self, key: str, default: Any = None) -> Any:
        """Return the value of a key, or the default if there is one and the key is missing."""
        if default is not None and key not in self._value:
            return default
        self._read.add(key)
        if key not in self._value:
            near = difflib.get_close_matches(key, self._value, 1)
            hint = f" ({near[0]} is there: is it misspelt?)" if {*near} - self._read else ""
            raise self.error(key, f"this key is missing; add it{hint}.")
        return self._value[key]

    def _pair(self, key: str, what: str) -> tuple[float, float]:
        first, second = self._numbers(key, what, 2)
        return first, second

    def _numbers(self, key: str, what: str, count: int | None = None) -> list[float]:
        """Return finite numbers, of which there are `count`, or any number but none."""
        value = self._get(key)
        if not isinstance(value, list | tuple) or len(value) != (count or len(value) or 1):
            comma = isinstance(value, list) and count is not None and len(value) == 2 * count
            hint = "; a comma ends a number, so write decimals with a point" if comma else ""
            raise self.error(key, f"{value!r} is not {what}{hint}.")
        return [self._finite(f"{key}[{i}]", item) for i, item in enumerate(value)]

    def _finite(self, key: str, value: Any) -> float:
        if isinstance(value, str):
            hint = "write it without its unit, with a decimal point, and powers as 2.1e+11"
            raise self.error(key, f"{value!r} is text, not a number; {hint}.")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(key, f"{value!r} is not a number.")
        if not abs(value) <= _LARGEST:
            raise self.error(key, f"{value!r} is not a finite number up to 1e+30; check its unit.")
        return float(value)
