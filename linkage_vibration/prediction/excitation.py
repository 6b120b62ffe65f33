# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Excitations: frequencies that follow the speed of the engine, the PTO or the ground."""

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from linkage_vibration.errors import LinkageVibrationError

RPM = 1.0 / 60.0
"""Turns a second (Hz) in one turn a minute."""

_LEAST, _LARGEST = 1e-6, 1e6  # of a number in a description


class ExcitationError(LinkageVibrationError):
    """A description of excitations cannot be used."""


class Source(enum.Enum):
    """A speed that excitations follow."""

    ENGINE = "engine"  # rpm
    PTO = "pto"  # rpm
    GROUND = "ground"  # m/s

    @property
    def unit(self) -> str:
        """Of the speed."""
        return "m/s" if self is Source.GROUND else "rpm"


@dataclass(frozen=True, slots=True)
class Excitation:
    """A frequency that follows a speed.

    Attributes
    ----------
    name : str
        Such as "engine 1.5".
    source : Source
        The speed.
    ratio : float
        Frequency for each unit of the speed, Hz/rpm or Hz/(m/s).
    """

    name: str
    source: Source
    ratio: float


def excitations_from_mapping(mapping: object, where: str = "excitations") -> tuple[Excitation, ...]:
    """Return the excitations that a mapping describes.

    Parameters
    ----------
    mapping : mapping
        For each name ``speed`` (engine, pto or ground) and ``orders``, turns of the excitation for
        one turn of that shaft; with ``ratio``, of a shaft that turns ``ratio`` times as fast. For
        ``ground``, ``rolling_radius`` (m) instead makes turns of metres.
    where : str
        Names the mapping in errors.

    Raises
    ------
    ExcitationError
        If a key is missing, unknown, or has no number that can be used.

    Examples
    --------
    >>> found = excitations_from_mapping({"shaft": {"speed": "pto", "orders": [1, 2]}})
    >>> [(one.name, round(540 * one.ratio, 6)) for one in found]
    [('shaft 1', 9.0), ('shaft 2', 18.0)]
    """
    if not isinstance(mapping, Mapping) or not mapping:
        raise ExcitationError(f"{where}: give at least one excitation by its name.")
    found: list[Excitation] = []
    for name, keys in mapping.items():
        place = f"{where}.{name}"
        if not (isinstance(name, str) and name.isprintable()):
            raise ExcitationError(f"{where}: {name!r} is no name; name an excitation in words.")
        if not isinstance(keys, Mapping):
            raise ExcitationError(f"{place}: give speed and orders.")
        unknown = set(keys) - {"speed", "orders", "ratio", "rolling_radius"}
        if unknown:
            raise ExcitationError(
                f"{place}.{sorted(map(str, unknown))[0]}: is not known; there are speed, orders, "
                "ratio and rolling_radius."
            )
        speeds = {source.value: source for source in Source}
        speed = keys.get("speed")
        if not isinstance(speed, str) or speed not in speeds:
            raise ExcitationError(f"{place}.speed: must be one of {', '.join(speeds)}.")
        source = speeds[speed]
        per_unit = RPM * _positive(keys.get("ratio", 1.0), f"{place}.ratio")
        if source is Source.GROUND:
            radius = _positive(keys.get("rolling_radius"), f"{place}.rolling_radius")
            per_unit *= 60.0 / (2.0 * math.pi * radius)
        elif "rolling_radius" in keys:
            raise ExcitationError(f"{place}.rolling_radius: belongs to speed: ground alone.")
        orders = keys.get("orders")
        if not isinstance(orders, Sequence) or isinstance(orders, str) or not orders:
            raise ExcitationError(f"{place}.orders: give a list of numbers, such as [1, 2].")
        for i, order in enumerate(orders):
            number = _positive(order, f"{place}.orders[{i}]")
            found.append(Excitation(f"{name} {number:g}", source, number * per_unit))
    return tuple(found)


def _positive(value: Any, place: str) -> float:
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not _LEAST <= value <= _LARGEST
    ):
        raise ExcitationError(
            f"{place}: must be a number from {_LEAST:g} to {_LARGEST:g}, not {value!r}."
        )
    return float(value)
