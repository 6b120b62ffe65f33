# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The limits that a bag is checked against, in Python or in a YAML file."""

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from numbers import Real
from pathlib import Path
from typing import Any

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.verdict import KNOWN
from linkage_vibration.readers.mechanism import load_yaml

Range = tuple[float, float]
OF_LOADS = "load_ratio", "velocity", "warning_time", "note_time"
"""The limits that may concern one excitation only."""


class TestKitError(LinkageVibrationError):
    """A bag cannot be checked against a limit."""

    __test__ = False  # its name begins like that of a test


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits of a check; None switches a limit off.

    Attributes
    ----------
    load_ratio : float, optional
        Largest allowed load ratio: force in a pin or cylinder (root mean square) over the static
        force there, 1.
    known_share : float, optional
        Least share of the drive, or of the windows, for which it is known whether each limit of a
        load, a velocity, a state, an angle or a frequency is exceeded, 0 to 1.
    statuses : tuple of Status, optional
        The allowed statuses of predictions.
    gap : float, optional
        Longest allowed time between two predictions, s.
    latency : float, optional
        Longest allowed time between sending a reading and sending its prediction, s; only a log
        that the node recorded contains it.
    velocity : float, optional
        Largest allowed velocity of the response point (root mean square), m/s.
    warning_time, note_time : float, optional
        Longest allowed time in all in which there is a warning, and in which there is at least a
        note, s.
    crank_angle_deg : tuple of float, optional
        Lowest and highest allowed crank angle, deg.
    frequencies : mapping of int to tuple of float, optional
        Lowest and highest allowed natural frequency, Hz, by the number of the mode, from 1.
    duration : float, optional
        Shortest allowed time from the first prediction to the last one, s.
    clock_jumps : float, optional
        Largest allowed number of jumps of the clock to an earlier time.
    input_faults : float, optional
        Largest allowed number of faults of the inputs, such as stamps, jumps or units.
    excitation : str, optional
        Name of the excitation that ``load_ratio``, ``velocity``, ``warning_time`` and ``note_time``
        concern, such as "engine 3"; None for all together.
    place : str, optional
        Pin or cylinder that ``load_ratio`` concerns, such as "lower_link:E1"; None for all.
    windows : tuple of (float, float), optional
        Times, s from the first prediction, in which limits are checked; None for the whole bag.
    baseline_tolerance : float, optional
        Largest allowed change of a number against a baseline, as a share of it, or of a tenth of
        the largest number of its kind in the baseline if that is more; None or 0 for no change.

    Raises
    ------
    TestKitError
        If a limit is negative, not a number or not an ascending range, a status is not a `Status`,
        or an excitation or a place has no limit that concerns it.
    """

    load_ratio: float | None = None
    known_share: float | None = KNOWN
    statuses: tuple[Status, ...] | None = (Status.OK,)
    gap: float | None = None
    latency: float | None = None
    velocity: float | None = None
    warning_time: float | None = None
    note_time: float | None = None
    crank_angle_deg: Range | None = None
    frequencies: Mapping[int, Range] | None = None
    duration: float | None = None
    clock_jumps: float | None = None
    input_faults: float | None = 0
    excitation: str | None = None
    place: str | None = None
    windows: tuple[Range, ...] | None = None
    baseline_tolerance: float | None = 0.05

    def __post_init__(self) -> None:
        """Check the limits."""
        for field in fields(self):
            value = getattr(self, field.name)
            valid = value is None or (_is_number(value) and value >= 0.0)
            if field.type == float | None and not valid:
                raise TestKitError(f"{field.name} is {value!r}; give a number from 0, or None.")
        if self.known_share is not None and self.known_share > 1.0:
            raise TestKitError(f"known_share is {self.known_share}; give at most 1, or None.")
        statuses = () if self.statuses is None else self.statuses
        for status in statuses if isinstance(statuses, list | tuple) else [statuses]:
            if status not in list(Status):
                names = ", ".join(Status.__members__)
                hint = "use Status, as Status.OK, or in a file one of"
                raise TestKitError(f"statuses contains {status!r}; {hint} {names}.")
        self._check_ranges()
        concerned = {"excitation": OF_LOADS, "place": OF_LOADS[:1]}
        for name, limits in concerned.items():
            value = getattr(self, name)
            if value is not None and not (isinstance(value, str) and value):
                raise TestKitError(f"{name} is {value!r}; give its name as text, or None.")
            if value is not None and all(getattr(self, limit) is None for limit in limits):
                raise TestKitError(f"{name} is {value!r}, but limits nothing; add {limits[0]}.")

    def _check_ranges(self) -> None:
        """Refuse what is not a range."""
        frequencies = {} if self.frequencies is None else self.frequencies
        if not isinstance(frequencies, Mapping) or any(
            not isinstance(mode, int) or mode < 1 for mode in frequencies
        ):
            text = f"frequencies is {frequencies!r}; give ranges by modes, from 1"
            raise TestKitError(f"{text}, such as {{1: [4, 9]}}.")
        windows = () if self.windows is None else self.windows
        if not isinstance(windows, list | tuple) or (self.windows is not None and not windows):
            raise TestKitError(f"windows is {windows!r}; give a list such as [[0, 10]], or None.")
        ranges = [(f"frequencies of mode {mode}", pair) for mode, pair in frequencies.items()]
        ranges += [(f"windows[{i}]", pair) for i, pair in enumerate(windows)]
        if self.crank_angle_deg is not None:
            ranges.append(("crank_angle_deg", self.crank_angle_deg))
        for name, pair in ranges:
            if not (
                isinstance(pair, list | tuple)
                and len(pair) == 2
                and all(map(_is_number, pair))
                and pair[0] < pair[1]
            ):
                raise TestKitError(f"{name} is {pair!r}; give two ascending numbers.")
        times = [time for pair in windows for time in pair]
        if times and (times[0] < 0.0 or times != sorted(times)):
            raise TestKitError(f"windows is {windows!r}; give ascending times from 0 s.")


def read_limits(path: Path) -> Limits:
    """Read a YAML file with the names of the fields of `Limits`; an error names file and key."""
    try:
        given = load_yaml(path)[0]
    except MechanismError as error:
        raise TestKitError(str(error)) from None
    names = [field.name for field in fields(Limits)]
    if not isinstance(given, dict):
        raise TestKitError(f"{path}: {given!r} holds no limits; add one, such as `gap: 0.05`.")
    for key in given:
        if key not in names:
            near = difflib.get_close_matches(str(key), names, 1) or [", ".join(names)]
            raise TestKitError(f"{path}: {key}: this key is not known; did you mean {near[0]}?")
    if isinstance(given.get("statuses"), list):
        found = [Status.__members__.get(str(name), name) for name in given["statuses"]]
        given["statuses"] = tuple(found)
    try:
        return Limits(**given)
    except TestKitError as error:
        raise TestKitError(f"{path}: {error}") from None


def _is_number(value: Any) -> bool:
    """Return whether a value is a finite number."""
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
