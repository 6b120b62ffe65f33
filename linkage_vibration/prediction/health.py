# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds faults of the inputs in their numbers: a level and a sentence for each.

Nothing here has a clock or knows ROS. A watch takes each reading. About once a second it returns
what was wrong since the last time.
"""

import enum
import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from linkage_vibration.prediction.excitation import Source

_FRESH = 1.0  # s; how long what a publisher sent counts
_STAMP_AHEAD = 0.1  # s; no clock that is synchronised runs ahead by more
_KEPT = 100  # angles outside the table

_FASTEST, _LEAST_JUMP = 4.0, 0.06  # rad/s and rad; a hitch is not faster, and noise not larger
_LEAST = 0.03  # rad; publishers that agree differ by less
_WAITING = 100_000  # readings, of which a judgement takes notice
_DIFFERING = 3  # values, from which publishers disagree
_PUBLISHERS = 8  # that are told apart

_NOISY = 100  # changes that tell noise from motion
_REMEMBERED = 1000  # changes
_TURNING = 0.3  # share of them that turn back
_FASTEST_VIBRATION = 20.0  # Hz; changes are noise if there are as many
_FROZEN = 2.0  # s without a change; noise does not stop for so long
_FROZEN_READINGS = 20
_CONTRADICTION = 0.1  # rad in a second, between positions and velocities

_STEADY = 3  # windows with a rate that counts as usual
_FALLEN = 0.5  # of the usual rate

_IMPLAUSIBLE_AFTER = 3.0  # s; a starter turns an engine slowly for a shorter time
_PLAUSIBLE = {
    Source.ENGINE: (400.0, 5000.0),
    Source.PTO: (0.0, 1500.0),
    Source.GROUND: (0.0, 25.0),
}
"""What an engine, a PTO shaft or a tractor that is not at rest does, rpm or m/s."""
_LEAST_DIFFERENCES = {Source.ENGINE: 50.0, Source.PTO: 20.0, Source.GROUND: 0.3}
"""Differences between publishers up to these are noise, rpm or m/s."""
_OTHER_UNITS = {
    Source.ENGINE: "rad/s or Hz",
    Source.PTO: "another unit",
    Source.GROUND: "km/h",
}


_Reading = tuple[float, int, int, float, float, bool, int]
"""What `ReadingWatch.take` takes, in its order."""


class Level(enum.IntEnum):
    """How serious a fault is; the constants of ``diagnostic_msgs/DiagnosticStatus``."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Fault:
    """What is wrong, and what to do about it."""

    level: Level
    sentence: str


def summary(faults: Sequence[Fault], sound: str) -> tuple[Level, str]:
    """Return the highest level of faults and their sentences, the most serious first.

    Parameters
    ----------
    faults : sequence of Fault
    sound : str
        The sentence without a fault.
    """
    if not faults:
        return Level.OK, sound
    ordered = sorted(faults, key=lambda fault: -fault.level)
    return ordered[0].level, " ".join(fault.sentence for fault in ordered)


@dataclass(slots=True)
class _Window:
    """What was seen since the last judgement."""

    received: int = 0  # values, and of these:
    invalid: int = 0
    unstamped: int = 0
    differing: int = 0  # those that differ from another publisher's
    jumps: int = 0  # changes that are too fast
    largest: float = 0.0  # of the changes that are too fast
    moved: float = 0.0  # rad, by the positions and by the velocities
    turned: float = 0.0
    outside: list[float] = field(default_factory=list)  # angles, not more than `_KEPT`
    n_outside: int = 0
    ages: tuple[float, float] = (math.inf, -math.inf)  # s, least and largest
    refusal: str = ""


@dataclass(slots=True)
class _Publisher:
    """What one publisher of a topic sent last."""

    sequence: int
    value: float
    change: float
    time: float  # s

    def follows(self, sequence: int, now: float) -> bool:
        """Return whether a message is the next one of this publisher."""
        return sequence == self.sequence + 1 and now - self.time < _FRESH

    def take(self, sequence: int, value: float, now: float) -> None:
        """Take a message."""
        self.change, self.sequence, self.value = value - self.value, sequence, value
        self.time = now


class _Publishers:
    """Tells the publishers of a topic apart by the sequence numbers of their messages.

    Parameters
    ----------
    least : float
        Differences up to this one count as noise.
    """

    def __init__(self, least: float) -> None:
        self._least = least
        self._known: list[_Publisher] = []

    def differs(self, sequence: int, value: float, now: float) -> bool:
        """Return whether a value differs from what another publisher sent just before.

        Parameters
        ----------
        sequence : int
            Number of the message by its publisher; 0 if it is not known.
        value, now : float
            The value, and when it arrived, s.
        """
        if len(self._known) == 1 and self._known[0].follows(sequence, now):
            self._known[0].take(sequence, value, now)
            return False
        known = [one for one in self._known if now - one.time < _FRESH][-_PUBLISHERS:]
        self._known = known
        own = min(
            (one for one in known if sequence > one.sequence or sequence == 0),
            key=lambda one: (sequence - one.sequence, abs(value - one.value)),
            default=None,
        )
        if own is None:
            own = _Publisher(sequence, value, 0.0, now)
            known.append(own)
        own.take(sequence, value, now)
        return any(
            abs(value - one.value) > self._least + abs(own.change) + abs(one.change)
            for one in known
            if one is not own
        )


@dataclass(frozen=True, slots=True)
class Expected:
    """What is expected of the readings.

    Attributes
    ----------
    name, remedy : str
        What is read, such as "joint hitch on /joint_states", and what to do if messages arrive
        without it; empty if they cannot.
    first, last : float
        Crank angles of the table, rad.
    offset : float
        Crank angle where the position is zero, rad; NaN if it is not a position.
    stale_after : float
        Age from which a reading is too old, s.
    publishers : callable
        Returns the names of the nodes that publish the topic, one for each publisher.
    shaken : bool
        Whether a speed says that the tractor runs, so that a noisy sensor must show its noise.
    """

    name: str
    remedy: str
    first: float
    last: float
    offset: float
    stale_after: float
    publishers: Callable[[], Sequence[str]]
    shaken: bool

    def contains(self, angle: float) -> bool:
        """Return whether the table has an angle, rad."""
        return self.first <= angle <= self.last


class ReadingWatch:
    """Watches the readings of the crank angle.

    Parameters
    ----------
    turns : bool
        Whether the crank turns all the way, so that it may be fast.
    """

    def __init__(self, turns: bool = False) -> None:
        self._fastest = math.inf if turns else _FASTEST
        self._publishers, self._noise = _Publishers(_LEAST), _Noise()
        self._window = _Window()
        self._time, self._stamp, self._angle = math.nan, 0, math.nan  # of the last reading
        self._waiting: deque[_Reading] = deque(maxlen=_WAITING)  # for the next judgement
        self._rates: deque[float] = deque(maxlen=_STEADY)  # Hz, of the last windows
        self._usual = 0.0  # Hz

    def take(
        self,
        now: float,
        stamp: int,
        received: int,
        angle: float,
        velocity: float,
        *,
        known: bool,
        sequence: int = 0,
    ) -> None:
        """Take a reading, which is looked at when `judge` is called, so that this is quick.

        Parameters
        ----------
        now : float
            Steady clock at its arrival, s.
        stamp, received : int
            Its stamp, and when it arrived by the clock of the stamps, ns.
        angle, velocity : float
            rad and rad/s; NaN if unknown.
        known : bool
            Whether the table has the angle.
        sequence : int
            Number of the message by its publisher; 0 if it is not known.
        """
        self._waiting.append((now, stamp, received, angle, velocity, known, sequence))

    def _look(self, reading: _Reading) -> None:
        """Look at a reading; see `take`."""
        now, stamp, received, angle, velocity, known, sequence = reading
        window = self._window
        window.received += 1
        if stamp:
            age = 1e-9 * (received - stamp)
            least, most = window.ages
            window.ages = min(least, age), max(most, age)
        else:
            window.unstamped += 1
        if not math.isfinite(angle):
            window.invalid += 1
        else:
            if not known:
                window.n_outside += 1
                if len(window.outside) < _KEPT:
                    window.outside.append(angle)
            apart = max(now - self._time, 1e-9 * (stamp - self._stamp))
            size = abs(angle - self._angle)
            if size > _LEAST_JUMP + self._fastest * apart:
                window.jumps += 1
                window.largest = max(window.largest, size)
            step = angle - self._angle
            if step == step and velocity == velocity and apart < _FRESH:  # neither is NaN
                window.moved += step
                window.turned += velocity * apart
            window.differing += self._publishers.differs(sequence, angle, now)
            self._noise.take(now, angle)
            self._angle = angle
        self._time, self._stamp = now, stamp

    def refuse(self, sentence: str) -> None:
        """Take a message that has no reliable reading, and why."""
        self._window.refusal = sentence

    def judge(self, now: float, elapsed: float, expected: Expected) -> list[Fault]:
        """Return what was wrong since the last call.

        Parameters
        ----------
        now, elapsed : float
            Steady clock, and the time since the last call, s.
        expected : Expected
        """
        while self._waiting:
            self._look(self._waiting.popleft())
        window, self._window = self._window, _Window()
        return [
            *self._missing(window, now, expected),
            *_range(window, expected),
            *_stamps(window, expected),
            *self._values(window, expected),
            *self._rate(window, elapsed),
        ]

    def _missing(self, window: _Window, now: float, expected: Expected) -> list[Fault]:
        if window.refusal:
            return [Fault(Level.ERROR, window.refusal)]
        age = now - self._time
        if window.received or age <= expected.stale_after:
            return []
        since = "" if math.isnan(age) else f" for {age:.1f} s"
        sentence = f"The node has not received {expected.name}{since}."
        if expected.remedy:
            return [Fault(Level.ERROR, f"{sentence} {expected.remedy}")]
        return [Fault(Level.STALE, sentence)]

    def _values(self, window: _Window, expected: Expected) -> list[Fault]:
        found = _disagreement(window, expected.publishers, expected.name)
        if not found and window.jumps:
            sentence = (
                f"{window.jumps} of {window.received} readings of {expected.name} jump by up to "
                f"{window.largest:.3g} rad, which a crank cannot; check the sensor and its cable."
            )
            found = [Fault(Level.WARN, sentence)]
        apart = abs(window.turned - window.moved)
        if apart > max(_CONTRADICTION, 0.5 * max(abs(window.turned), abs(window.moved))):
            sentence = (
                f"The velocity of {expected.name} turned the crank by {window.turned:.2g} rad, but "
                f"the position by {window.moved:.2g} rad; the sensor is frozen, or its velocity is "
                "wrong. Publish no velocity if it is not known."
            )
            found.append(Fault(Level.WARN, sentence))
        frozen = self._noise.frozen(expected.shaken) if window.received else ""
        if frozen:
            found.append(Fault(Level.WARN, f"{expected.name}: {frozen}"))
        return found

    def _rate(self, window: _Window, elapsed: float) -> list[Fault]:
        rate = window.received / elapsed
        self._rates.append(rate)
        if len(self._rates) == _STEADY:
            self._usual = max(self._usual, min(self._rates))
        if not rate or max(list(self._rates)[-2:]) >= _FALLEN * self._usual:
            return []
        sentence = (
            f"The readings arrive at {rate:.1f} Hz instead of {self._usual:.1f} Hz; check the "
            "sensor's driver, the network and the load of the machine."
        )
        return [Fault(Level.WARN, sentence)]


def _range(window: _Window, expected: Expected) -> list[Fault]:
    if window.invalid and window.invalid == window.received:
        sentence = f"No reading of {expected.name} is a number; check the sensor."
        return [Fault(Level.ERROR, sentence)]
    if not window.n_outside or window.n_outside + window.invalid < window.received:
        return []
    angles, offset = list(window.outside), expected.offset
    first, last = math.degrees(expected.first), math.degrees(expected.last)
    table = f"the table's {first:.4g} to {last:.4g} deg"
    position = angles[-1] - offset
    if all(expected.contains(offset + math.radians(angle - offset)) for angle in angles):
        sentence = (
            f"The readings of {expected.name} are in degrees ({position:.4g}), but radians are "
            "expected; publish radians, or set hitch_unit to deg."
        )
    elif all(expected.contains(2.0 * offset - angle) for angle in angles):
        sentence = (
            f"All crank angles of {expected.name} are outside {table} "
            f"({math.degrees(angles[-1]):.4g} deg), but inside with the other sign; change the "
            "parameter sign."
        )
    else:
        below, above = (
            all(angle < expected.first for angle in angles),
            all(angle > expected.last for angle in angles),
        )
        side = "below" if below else "above" if above else "outside"
        sentence = (
            f"All crank angles of {expected.name} are {side} {table} "
            f"({math.degrees(angles[-1]):.4g} deg); check sign, scale and offset."
        )
    return [Fault(Level.ERROR, sentence)]


def _stamps(window: _Window, expected: Expected) -> list[Fault]:
    least, most = window.ages
    advice = "synchronise the clocks, or set use_sim_time if a bag is played with its clock."
    found = []
    if window.unstamped:
        found.append(
            f"The stamps of {window.unstamped} of {window.received} readings are zero, so that "
            "motion and delays are not known; set header.stamp where the message is published."
        )
    if expected.stale_after < least < math.inf:
        found.append(f"The stamps of the readings are {least:.1f} s old; {advice}")
    if -math.inf < most < -_STAMP_AHEAD:
        found.append(f"The stamps of the readings are {-most:.1f} s in the future; {advice}")
    return [Fault(Level.WARN, sentence) for sentence in found]


def _disagreement(
    window: _Window, publishers: Callable[[], Sequence[str]], name: str
) -> list[Fault]:
    """Return that publishers of one topic disagree, and their nodes.

    After a restart, a publisher is alone, although its messages are numbered from 1 again.
    """
    nodes = publishers() if window.differing >= _DIFFERING else []
    if len(nodes) < 2:
        return []
    listing = ", ".join(sorted(nodes))
    sentence = f"The publishers of {name} disagree ({listing}); stop or remap all but one."
    return [Fault(Level.ERROR, sentence)]


class _Noise:
    """Finds out whether a sensor is noisy, and when its noise ends, as it does if it is frozen.

    A sensor with coarse steps repeats its value while the hitch stands still, for as long as it
    does. So a value that does not change is a fault only if the sensor never repeated a value for
    nearly as long before although something shakes it.
    """

    def __init__(self) -> None:
        self._began = self._time = math.nan  # s, of the first and the last reading
        self._value, self._change = math.nan, 0.0
        self._changes = self._turns = self._longest = self._run = 0
        self._since = math.nan  # s, of the present run

    def take(self, now: float, value: float) -> None:
        """Take a reading; see `ReadingWatch.take`."""
        if value == self._value:
            self._run += 1
        else:
            change = value - self._value
            self._turns += change * self._change < 0.0
            self._changes += 1
            self._longest = max(self._longest, self._run)
            self._run, self._since = 0, now
            self._value, self._change = value, change
            if math.isnan(self._began):
                self._began = now
            elif self._changes >= _REMEMBERED:
                self._changes, self._turns = self._changes // 2, self._turns // 2
                self._longest, self._began = self._longest // 2, 0.5 * (self._began + now)
        self._time = now

    def frozen(self, shaken: bool) -> str:
        """Return why the sensor must be frozen; empty if it need not be."""
        still = self._time - self._since
        if not still >= _FROZEN or self._run < _FROZEN_READINGS:
            return ""
        text = f"The reading has been the same for {still:.1f} s"
        noisy = (
            self._changes >= _NOISY
            and self._turns >= _TURNING * self._changes
            and self._changes >= _FASTEST_VIBRATION * (self._since - self._began)
            and (self._longest == 0 or shaken)
        )
        if not noisy or self._run < 10 * self._longest:
            return ""
        return f"{text}, although it was never free of noise before; the sensor is frozen."


class SpeedWatch:
    """Watches a speed of the tractor.

    Parameters
    ----------
    source : Source
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._publishers, self._window = _Publishers(_LEAST_DIFFERENCES[source]), _Window()
        self._time = self._since = math.nan  # s, of the last value and of the last plausible one
        self._value = math.nan

    def take(self, now: float, value: float, sequence: int = 0) -> None:
        """Take a value.

        Parameters
        ----------
        now : float
            Steady clock at its arrival, s.
        value : float
            rpm or m/s.
        sequence : int
            Number of the message by its publisher; 0 if it is not known.
        """
        low, high = _PLAUSIBLE[self._source]
        resumed = not now - self._time <= _FRESH
        if resumed or value == 0.0 or low <= abs(value) <= high:
            self._since = now
        self._window.received += 1
        self._window.differing += self._publishers.differs(sequence, value, now)
        self._time, self._value = now, value

    def turns(self, now: float) -> bool:
        """Return whether the speed is fresh and not zero at a time (steady clock, s)."""
        return now - self._time < _FRESH and abs(self._value) > 0.0

    def judge(
        self, now: float, topic: str, stale_after: float, publishers: Callable[[], Sequence[str]]
    ) -> list[Fault]:
        """Return what was wrong since the last call; nothing if the speed never arrived.

        Parameters
        ----------
        now : float
            Steady clock, s.
        topic : str
            Where the speed is published.
        stale_after : float
            Age from which it is too old, s.
        publishers : callable
            Returns the names of the nodes that publish it, one for each publisher.
        """
        source, value = self._source, self._value
        window, self._window = self._window, _Window()
        name = f"{'PTO' if source is Source.PTO else source.value} speed on {topic}"
        age, problem, found = now - self._time, "", []
        if age > stale_after:
            problem = f"The {name} stopped {age:.1f} s ago; check its publisher."
        elif not math.isfinite(value) and age >= 0.0:
            problem = f"The {name} is {value}, so that it is not known; check its publisher."
        elif value < 0.0 and source is not Source.GROUND:
            problem = f"The {name} is negative ({value:g} rpm); publish its magnitude."
        elif now - self._since > _IMPLAUSIBLE_AFTER:
            problem = (
                f"The {name} has been {value:.4g} {source.unit}, which is not plausible, for "
                f"{now - self._since:.0f} s; is it in {_OTHER_UNITS[source]}?"
            )
        if problem:
            found.append(Fault(Level.WARN, problem))
        return found + _disagreement(window, publishers, f"the {name}")
