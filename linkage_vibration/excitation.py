# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What excites the linkage, and how near that is to one of its natural frequencies."""

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.prediction import Prediction

RPM = 1.0 / 60.0
"""Turns a second (Hz) in one turn a minute."""

# Between two values that a rate is taken of; of a burst's it would be that of its delivery.
_SHORTEST = 5e-3  # s
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


class ResonanceState(enum.IntEnum):
    """How near the nearest excitation is; the message's constants."""

    CLEAR = 0
    WARNING = 1
    STALE = 2


@dataclass(frozen=True, slots=True)
class Resonance:
    """The excitation that is nearest to a natural frequency.

    Attributes
    ----------
    state : ResonanceState
        Every number below is NaN (the mode 0) when it is STALE.
    excitation : str
        Its name; empty when stale.
    excitation_frequency : float
        Hz.
    mode : int
        Index of the natural frequency.
    natural_frequency : float
        Hz.
    margin, relative_margin : float
        Excitation less natural frequency, Hz, and the same over the natural frequency, 1.
    approach : int
        1 where they come nearer, -1 where they part, 0 where neither.
    time_to_crossing : float
        At the present rates, s; infinite where they do not meet.
    table_id : str
        Of the prediction.
    """

    state: ResonanceState
    excitation: str
    excitation_frequency: float
    mode: int
    natural_frequency: float
    margin: float
    relative_margin: float
    approach: int
    time_to_crossing: float
    table_id: str


@dataclass(frozen=True, slots=True)
class _Speed:
    """A speed as it was told last."""

    value: float
    time: int | None  # ns; None where it is fixed
    rate: float = 0.0  # a second
    earlier: tuple[float, int] = (0.0, 0)  # value and time (ns) that the next rate goes back to


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


class ResonanceMonitor:
    """Holds excitations against predictions.

    It has no clock: the same calls give the same answers, live or offline.

    Parameters
    ----------
    excitations : sequence of Excitation
        All that are watched.
    warning_margin : float
        Relative margin below which it warns, 1.
    hysteresis : float
        By how much the margin has to exceed that until the warning ends, 1. The warning belongs to
        the nearest pair, whichever that is, so that it does not flicker where two take turns.
    stale_after : float
        Age of a speed from which it is not used, s.
    """

    def __init__(
        self,
        excitations: Sequence[Excitation],
        warning_margin: float = 0.1,
        hysteresis: float = 0.02,
        stale_after: float = 1.0,
    ) -> None:
        self.excitations = tuple(excitations)
        self.warning_margin = warning_margin
        self.hysteresis = hysteresis
        self.stale_after = stale_after
        self._speeds: dict[Source, _Speed] = {}
        self._warning = self._told = False

    def set_speed(self, source: Source, value: float, time: int) -> None:
        """Take a speed as told at a time; its rate follows from the last two.

        Parameters
        ----------
        source : Source
            Whose speed.
        value : float
            rpm or m/s; where it is negative or no finite number, the last one is forgotten too.
        time : int
            When it was told, ns. Values that come within 5 ms count as one for the rate, which
            starts anew when the clock jumps back, or after `stale_after`.
        """
        self._told = True
        if not 0.0 <= value < math.inf:
            self._speeds.pop(source, None)
            return
        last = self._speeds.get(source)
        rate, earlier = 0.0, (value, time)
        if last is not None and last.time is not None:
            before, since = last.earlier
            apart = 1e-9 * (time - since)
            if 0.0 <= apart < _SHORTEST:
                rate, earlier = last.rate, last.earlier
            elif _SHORTEST <= apart < self.stale_after:
                rate = (value - before) / apart
        self._speeds[source] = _Speed(value, time, rate, earlier)

    @property
    def speeds_told(self) -> bool:
        """Whether any speed has ever been told; without, there is nothing to assess."""
        return self._told

    def is_fixed(self, source: Source) -> bool:
        """Whether a speed is one that does not change."""
        speed = self._speeds.get(source)
        return speed is not None and speed.time is None

    def set_fixed(self, source: Source, value: float) -> None:
        """Take a speed (rpm or m/s) as one that does not change."""
        self._told = True
        self._speeds[source] = _Speed(value, None)

    def forget(self, source: Source) -> None:
        """Forget a speed."""
        self._speeds.pop(source, None)

    def assess(self, prediction: Prediction, velocity: float, time: int) -> Resonance:
        """Return the excitation that is nearest to a natural frequency.

        Parameters
        ----------
        prediction : Prediction
            Of any status.
        velocity : float
            Of the crank, rad/s; where it is NaN, not known, the crank is taken to stand still.
        time : int
            When the prediction was made, by the clock that speeds are told by, ns.
        """
        fresh = self._fresh(time) if prediction.status.has_numbers else {}
        naturals = prediction.natural_frequencies.tolist()
        nearest, best, mode = math.inf, None, 0
        for excitation in self.excitations:
            speed = fresh.get(excitation.source)
            if speed is None or speed.value == 0.0:
                continue
            frequency = excitation.ratio * speed.value
            for i, natural in enumerate(naturals):
                apart = abs(frequency / natural - 1.0)
                if apart < nearest:
                    nearest, best, mode = apart, excitation, i
        if best is None:
            self._warning = False
            nan = math.nan
            return Resonance(
                ResonanceState.STALE, "", nan, 0, nan, nan, nan, 0, nan, prediction.table_id
            )
        limit = self.warning_margin + (self.hysteresis if self._warning else 0.0)
        self._warning = nearest < limit
        speed = fresh[best.source]
        frequency, natural = best.ratio * speed.value, naturals[mode]
        margin = frequency - natural
        turning = 0.0
        if velocity == velocity:  # it is a number
            turning = float(prediction.frequency_slopes[mode]) * velocity
        rate = best.ratio * speed.rate - turning
        closing = float(-rate if margin > 0.0 else rate)  # Hz/s, by which the distance shrinks
        return Resonance(
            state=ResonanceState.WARNING if self._warning else ResonanceState.CLEAR,
            excitation=best.name,
            excitation_frequency=frequency,
            mode=mode,
            natural_frequency=natural,
            margin=margin,
            relative_margin=margin / natural,
            approach=(closing > 0.0) - (closing < 0.0),
            time_to_crossing=abs(margin) / closing if closing > 0.0 else math.inf,
            table_id=prediction.table_id,
        )

    def _fresh(self, time: int) -> dict[Source, _Speed]:
        """Speeds that are neither old nor from a time that the clock has jumped back from."""
        limit = 1e9 * self.stale_after
        return {
            source: speed
            for source, speed in self._speeds.items()
            if speed.time is None or -limit <= time - speed.time <= limit
        }
