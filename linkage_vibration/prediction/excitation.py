# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Excitations: frequencies that follow the speed of the engine, the PTO or the ground."""

import enum
import math
from dataclasses import dataclass

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.mechanics.keys import Keys

RPM = 1.0 / 60.0
"""1/min in Hz."""

_LEAST, _LARGEST = 1e-6, 1e6  # of a number in a description


class ExcitationError(LinkageVibrationError):
    """A description of excitations is invalid."""


class Source(enum.Enum):
    """A speed to which excitation frequencies are proportional."""

    ENGINE = "engine"  # rpm
    PTO = "pto"  # rpm
    GROUND = "ground"  # m/s

    @property
    def unit(self) -> str:
        """Unit of the speed."""
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
        Frequency per speed, Hz/rpm or Hz/(m/s).
    """

    name: str
    source: Source
    ratio: float


def excitations_from_mapping(mapping: object, where: str = "excitations") -> tuple[Excitation, ...]:
    """Return the excitations that a mapping describes.

    Parameters
    ----------
    mapping : mapping
        For each name ``speed`` (engine, pto or ground) and ``orders``, turns of the excitation per
        turn of that shaft. ``ratio`` is the speed of the excited shaft per speed of that shaft. For
        ``ground``, ``rolling_radius`` (m) converts metres to turns.
    where : str
        Path of the mapping in errors.

    Raises
    ------
    ExcitationError
        If a key is missing, unknown, or has an invalid value.

    Examples
    --------
    >>> found = excitations_from_mapping({"shaft": {"speed": "pto", "orders": [1, 2]}})
    >>> [(one.name, round(540 * one.ratio, 6)) for one in found]
    [('shaft 1', 9.0), ('shaft 2', 18.0)]
    """
    try:
        keys = Keys(where, mapping)
        found = [excitation for name in keys for excitation in _orders(keys[name], name)]
        keys.refuse_unknown()
    except MechanismError as error:
        raise ExcitationError(str(error)) from None
    if not found:
        raise ExcitationError(f"{where}: there is no excitation; give at least one by its name.")
    return tuple(found)


def _orders(keys: Keys, name: str) -> list[Excitation]:
    """Return one excitation for each order."""
    if not name.isprintable():
        raise MechanismError(keys.path, f"{name!r} cannot be printed; give another name.")
    source = Source(keys.choice("speed", [source.value for source in Source]))
    per_unit = RPM * _in_range(keys, "ratio", keys.number("ratio", default=1.0))
    if source is Source.GROUND:
        radius = _in_range(keys, "rolling_radius", keys.number("rolling_radius"))
        per_unit *= 60.0 / (2.0 * math.pi * radius)
    orders = keys.numbers("orders")
    return [
        Excitation(f"{name} {order:g}", source, _in_range(keys, f"orders[{i}]", order) * per_unit)
        for i, order in enumerate(orders)
    ]


def _in_range(keys: Keys, key: str, number: float) -> float:
    if not _LEAST <= number <= _LARGEST:
        raise keys.error(key, f"{number:g} is not from {_LEAST:g} to {_LARGEST:g}.")
    return number
