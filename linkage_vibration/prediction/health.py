# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Finds faults of the inputs in their numbers: a level and a sentence for each.

Nothing here has a clock or knows ROS. A watch takes each reading. About once a second it returns
what was wrong since the last time.
"""

import enum
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import median_low

from linkage_vibration.prediction.agreement import AGREEMENT, FASTEST, LEAST_JUMP, Agreement
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.inputs.presets import HITCH
from linkage_vibration.prediction.motion import wrapped_turn

_FRESH = 1.0  # s; what is older does not belong to the present motion or speed
_STAMP_AHEAD = 0.1  # s; the stamps of synchronised clocks are ahead by less
_KEPT = 100  # at most so many angles outside the table are kept
LASTING = 10.0  # s; a fault that comes and goes has ended when it has not come for so long

_EARLIEST = -(2**63)  # ns
_WAITING = 100_000  # at most so many readings wait for the next judgement
_SHARE = 0.02  # Publishers disagree if this share of the values, or more, go to and fro.

_NOISY = 100  # a sensor is noisy only if it repeated no value in the last so many changes,
_TURNING = 0.3  # and if this share of them reversed the direction
_FROZEN, _FROZEN_READINGS = 2.0, 20  # s; a noisy sensor repeats its value for less than both
_CONTRADICTION = 0.1  # rad in a second; positions and velocities that agree differ by less

_USUAL = 30  # the usual rate is the median of so many windows, so that it follows a lasting change
_FALLEN = 0.6  # a rate below this share of the usual one is a fault
_FEW = 10  # readings; if fewer arrive while others are left out, their rate is not known
_GAP = 0.15  # s; over longer gaps that the node makes itself, a motion is not known
_NO_NUMBERS = 0.1  # more than this share of readings that are no number is a fault,
_REPEATED = 0.1  # and of those that have the stamp of the one before

_IMPLAUSIBLE_AFTER = 3.0  # s; a starter turns an engine slowly for a shorter time
_PLAUSIBLE = {
    Source.ENGINE: (400.0, 5000.0),
    Source.PTO: (120.0, 1500.0),
    Source.GROUND: (0.0, 25.0),
}
"""The range of speeds of an engine, a PTO shaft or a tractor that is not at rest, rpm or m/s."""
_SWING = {Source.ENGINE: 400.0, Source.PTO: 120.0, Source.GROUND: 2.0}
_SWING_TIME, _SWINGS = 0.4, 3  # s; nothing changes so much to and fro in it, so often in a second
_RUN_OUT = 10.0  # s; a PTO turns for a shorter time after the engine has stopped
_OTHER_UNITS = {Source.ENGINE: "rad/s or Hz", Source.PTO: "rad/s or Hz", Source.GROUND: "km/h"}

_Nodes = Callable[[], Sequence[str]] | None  # in a bag, nobody knows them
_Reading = tuple[float, int, int, float, float, bool, str]  # as `ReadingWatch.take` has them


class Level(enum.IntEnum):
    """How serious a fault is; the constants of ``diagnostic_msgs/DiagnosticStatus``."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Fault:
    """A sentence that says what is wrong, and what to do about it."""

    level: Level
    sentence: str
    event: str = ""  # what comes and goes; empty for a fault that lasts as long as its cause
    since: float = math.nan  # s; values are doubted since then (-inf: all), or not at all (NaN)


class Recent:
    """Keeps the faults that come and go until they have not come for `LASTING` s."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[float, Fault]] = {}  # by event, with its time, s

    def with_earlier(self, now: float, faults: Sequence[Fault]) -> list[Fault]:
        """Return the faults of the time ``now`` (s), and those that have not ended since."""
        self._last |= {fault.event: (now, fault) for fault in faults if fault.event}
        earlier = [(now - at, f) for at, f in self._last.values() if 0.0 < now - at < LASTING]
        words = "{} This was {:.0f} s ago."
        kept = [replace(f, sentence=words.format(f.sentence, age)) for age, f in earlier]
        return [*faults, *kept]


def overall(faults: Sequence[Fault], sound: str) -> tuple[Level, str]:
    """Return the highest level, and all sentences, the most serious first; ``sound`` if none."""
    if not faults:
        return Level.OK, sound
    ordered = sorted(faults, key=lambda fault: -fault.level)
    return ordered[0].level, " ".join(fault.sentence for fault in ordered)


@dataclass(slots=True)
class _Window:
    """Counts and extremes since the last judgement."""

    received: int = 0  # values, the first of them at ``began``, s, and of these:
    began: float = math.nan
    invalid: int = 0
    unstamped: int = 0
    repeated: int = 0  # stamps that are those of the reading before
    differing: int = 0  # values that go to and fro
    senders: dict[str, float] = field(default_factory=dict)  # on one bus, with their last values
    jumps: int = 0  # changes that are too fast, and the largest of them
    largest: float = 0.0
    moved: float = 0.0  # rad, by the positions, and by the velocities
    turned: float = 0.0
    still: float = 0.0  # s, for how long the reading of a noisy sensor was the same,
    frozen: float = math.nan  # and since when, s
    outside: list[float] = field(default_factory=list)  # rad, at most `_KEPT` angles
    n_outside: int = 0
    ages: tuple[float, float] = (math.inf, -math.inf)  # s, the least and the largest
    refusal: str = ""

    def count(self, now: float) -> None:
        """Count a value at a time, s."""
        self.began = self.began if self.received else now
        self.received += 1


@dataclass(frozen=True, slots=True)
class ReadingExpectation:
    """What is expected of the readings."""

    name: str  # what is read, such as "joint hitch on /joint_states"
    remedy: str  # why it may be missing, and what to do about it
    others: bool  # whether messages arrive without it
    first: float  # rad, the crank angle at which the table begins
    last: float  # rad, the crank angle at which the table ends
    offset: float  # rad, the crank angle at the position 0; NaN if the input is no angle
    stale_after: float  # s, the age from which a reading is too old
    since: float  # s, steady clock, from when on it is expected
    publishers: _Nodes  # returns the node of each publisher
    taken: float = 1.0  # share of the messages that were neither lost nor left out by the node

    def contains(self, angle: float) -> bool:
        """Return whether the table has an angle, rad."""
        return self.first <= angle <= self.last


class ReadingWatch:
    """Watches the readings of the crank angle; a crank that turns all the way may be fast."""

    def __init__(self, turns: bool = False, stamps_back: int = 0) -> None:
        self.last = math.nan  # steady clock, s, when the last judged reading arrived
        self.stamp_age = math.nan  # s, of this reading
        self.stamps_back = stamps_back  # readings whose stamp was earlier than the one before
        self._fastest = math.inf if turns else FASTEST
        self._noise, self._window = _Noise(), _Window()
        self._recent = Recent()
        self._stamp, self._angle = _EARLIEST, math.nan  # of the last reading
        self._received = _EARLIEST
        self._agreement = Agreement(HITCH, turns)
        self._waiting: deque[_Reading] = deque(maxlen=_WAITING)  # for the next judgement
        self._rates: deque[float] = deque(maxlen=_USUAL)  # Hz, of the last windows with readings

    def take(
        self,
        now: float,
        stamp: int,
        received: int,
        angle: float,
        velocity: float,
        *,
        known: bool,
        sender: str = "",
    ) -> None:
        """Take a reading, which is looked at when `judge` is called, so that this is quick.

        It arrived at ``now`` (steady clock, s) and ``received`` (clock of the stamps, ns), with rad
        and rad/s; ``known``: the table has the angle; ``sender``: as in `NumberReader`.
        """
        self._waiting.append((now, stamp, received, angle, velocity, known, sender))

    def _look(self, reading: _Reading, taken: float) -> None:
        """Look at a reading; see `take`."""
        now, stamp, received, angle, velocity, in_table, sender = reading
        window = self._window
        window.count(now)
        self.stamps_back += stamp < self._stamp
        self.stamp_age = age = 1e-9 * (received - stamp)
        if stamp:
            least, most = window.ages
            window.ages = min(least, age), max(most, age)
            window.repeated += stamp == self._stamp and not sender  # A bus stamps by arrival.
        else:
            window.unstamped += 1
        if sender:
            window.senders[sender] = angle
        if not math.isfinite(angle):
            window.invalid += 1
        else:
            if not in_table:
                window.n_outside += 1
                if len(window.outside) < _KEPT:
                    window.outside.append(angle)
            # Readings that waited are taken at once, so the time of their receipt counts too.
            received_apart = max(stamp - self._stamp, received - self._received)
            apart = max(now - self.last, 1e-9 * received_apart)
            close = apart < (_FRESH if taken == 1.0 else _GAP)
            step = angle - self._angle + wrapped_turn(angle, self._angle)
            size = abs(step)
            if apart >= 0.0 and size > LEAST_JUMP + self._fastest * apart:  # else a clock jumps
                window.jumps += 1
                window.largest = max(window.largest, size)
            if step == step and velocity == velocity and close:  # neither is NaN
                window.moved += step
                window.turned += velocity * apart
            differs = self._agreement.take(round(1e9 * now), angle)
            window.differing += differs and (close or taken == 1.0)
            if not self._agreement.is_lost(round(1e9 * now)):
                # Two sensors that agree again are not frozen.
                self._noise.take(now, angle)
            if self._noise.has_ended:
                window.still, window.frozen = self._noise.still, now - self._noise.still
            self._angle = angle
        self.last, self._stamp, self._received = now, stamp, received

    def refuse(self, sentence: str) -> None:
        """Take a message that has no reliable reading, and why."""
        self._window.refusal = sentence

    def judge(self, now: float, elapsed: float, expected: ReadingExpectation) -> list[Fault]:
        """Return what was wrong since the last call, which was ``elapsed`` (s) before ``now``."""
        while self._waiting:
            self._look(self._waiting.popleft(), expected.taken)
        window, self._window = self._window, _Window()
        faults = [
            *self._missing(window, now, expected),
            *_range(window, expected),
            *_stamps(window, expected),
            *self._values(window, expected),
            *self._rate(window, elapsed, expected.taken),
        ]
        return self._recent.with_earlier(now, faults)

    def _missing(self, window: _Window, now: float, expected: ReadingExpectation) -> list[Fault]:
        if window.refusal:
            return [Fault(Level.ERROR, window.refusal, "refusal")]
        never = math.isnan(self.last)
        age = now - (expected.since if never else self.last)
        if window.received or (age <= expected.stale_after and not never):
            return []
        sentence = f"The node has not received {expected.name} for {age:.1f} s. {expected.remedy}"
        return [Fault(Level.ERROR if expected.others else Level.STALE, sentence.rstrip())]

    def _values(self, window: _Window, expected: ReadingExpectation) -> list[Fault]:
        faults, sentences = _disagreement(window, expected.publishers, expected.name, HITCH), {}
        if not faults and window.jumps:
            sentences["jumps"] = (
                f"{window.jumps} of {window.received} readings of {expected.name} jump by up to "
                f"{window.largest:.3g} rad, which a crank cannot; check the sensor and its cable."
            )
        apart = abs(window.turned - window.moved)
        if apart > max(_CONTRADICTION, 0.5 * max(abs(window.turned), abs(window.moved))):
            sentences["velocity"] = (
                f"The velocity of {expected.name} turned the crank by {window.turned:.2g} rad, but "
                f"the position by {window.moved:.2g} rad; the sensor is frozen, or its velocity is "
                "wrong. Publish no velocity if it is not known."
            )
        if window.still:
            sentences[""] = (
                f"{expected.name}: The reading has been the same for {window.still:.1f} s, "
                "although it was never free of noise before; the sensor is frozen."
            )
        since = {"": window.frozen}
        return faults + [
            Fault(Level.WARN, text, event, since.get(event, window.began))
            for event, text in sentences.items()
        ]

    def _rate(self, window: _Window, elapsed: float, taken: float) -> list[Fault]:
        if not window.received or (taken < 1.0 and window.received < _FEW):
            return []
        rate = window.received / taken / elapsed  # at which the sensor sends
        self._rates.append(rate)
        usual = median_low(self._rates)
        if max(list(self._rates)[-2:]) >= _FALLEN * usual:
            return []
        sentence = (
            f"The readings come at {rate:.1f} Hz instead of {usual:.1f} Hz; check the sensor's "
            "driver, and the loads of its machine and of the node's."
        )
        return [Fault(Level.WARN, sentence)]


def _range(window: _Window, expected: ReadingExpectation) -> list[Fault]:
    if window.invalid and window.invalid == window.received:
        sentence = f"No reading of {expected.name} is a number; check the sensor."
        return [Fault(Level.ERROR, sentence)]
    faults = []
    if window.invalid > _NO_NUMBERS * window.received:
        sentence = (
            f"{100.0 * window.invalid / window.received:.0f} % of the readings of {expected.name} "
            "are no numbers; check the sensor and its cable."
        )
        faults = [Fault(Level.WARN, sentence, "no numbers")]
    return faults + _outside(window, expected)


def _outside(window: _Window, expected: ReadingExpectation) -> list[Fault]:
    if not window.n_outside or window.n_outside + window.invalid < window.received:
        return []
    angles, offset = window.outside, expected.offset
    side, advice = "outside", "check hitch_sign, hitch_scale and hitch_offset."
    turned = [angle - offset for angle in angles]
    if max(map(abs, turned)) > math.pi and all(
        expected.contains(offset + math.radians(angle)) for angle in turned
    ):
        sentence = (
            f"The readings of {expected.name} are in degrees ({turned[-1]:.4g}), but "
            "radians are expected; publish radians, or set hitch_unit to deg."
        )
        return [Fault(Level.ERROR, sentence, since=-math.inf)]
    if all(expected.contains(2.0 * offset - angle) for angle in angles):
        advice = "but they are inside with the other sign; change the parameter hitch_sign."
    elif max(angles) < expected.first:
        side = "below"
    elif min(angles) > expected.last:
        side = "above"
    degrees = (f"{math.degrees(a):.4g}" for a in (expected.first, expected.last, angles[-1]))
    sentence = "All values of {} are {} the table's {} to {} deg ({} deg); {}"
    return [Fault(Level.ERROR, sentence.format(expected.name, side, *degrees, advice))]


def _stamps(window: _Window, expected: ReadingExpectation) -> list[Fault]:
    least, most = window.ages
    advice = "synchronise the clocks, or set use_sim_time exactly if a clock is published."
    sentences = []
    if window.unstamped:
        sentences.append(
            f"The stamps of {window.unstamped} of {window.received} readings are zero, so that "
            "motion and delays are not known; set header.stamp where the message is published."
        )
    if window.repeated > max(1.0, _REPEATED * window.received):
        sentences.append(
            f"{window.repeated} of {window.received} stamps of readings are those of the reading "
            "before, so that motion is not known; set header.stamp to the time of each reading."
        )
    if expected.stale_after < least < math.inf:
        sentences.append(f"The stamps of the readings are {least:.1f} s old; {advice}")
    if -math.inf < most < -_STAMP_AHEAD:
        sentences.append(f"The stamps of the readings are {-most:.1f} s in the future; {advice}")
    return [Fault(Level.WARN, sentence) for sentence in sentences]


def senders_disagree(senders: Mapping[str, float], what: str, name: str) -> str:
    """Return the sentence that senders on a bus, with a value of each, disagree about an input."""
    unit = AGREEMENT[name][2]
    values = {
        s: "not available" if math.isnan(v) else f"{v:.4g} {unit}" for s, v in senders.items()
    }
    listing = ", ".join(f"{sender}: {value}" for sender, value in sorted(values.items()))
    return f"The senders of {what} disagree ({listing}); set {name}_field to one of them."


def _disagreement(window: _Window, publishers: _Nodes, what: str, name: str) -> list[Fault]:
    """Return the fault that the senders or the publishers of a value disagree, with their names."""
    absent = [math.isnan(value) for value in window.senders.values()]
    partly = any(absent) and not all(absent)  # one sender is available, and another one is not
    if window.differing < max(1.0, _SHARE * window.received) and not partly:
        return []
    if len(window.senders) > 1:
        sentence = senders_disagree(window.senders, what, name)
        return [Fault(Level.ERROR, sentence, since=window.began)]
    if publishers is not None and len(nodes := publishers()) > 1:
        listing = ", ".join(sorted(nodes))
        sentence = f"The publishers of {what} disagree ({listing}); stop or remap all but one."
    elif publishers is not None and window.jumps:
        return []  # these have a sentence of their own
    else:
        fix = "check the sensor" if publishers else "record one of them alone"
        sentence = (
            f"The values of {what} go to and fro, as those of publishers that disagree; {fix}."
        )
    return [Fault(Level.ERROR, sentence, since=window.began)]


class _Noise:
    """Finds out whether the noise of a sensor has ended, because the sensor is frozen.

    A sensor with coarse steps repeats its value for as long as the hitch stands still. So a value
    that does not change is a fault only if none was repeated for many changes before.
    """

    def __init__(self) -> None:
        self.still = 0.0  # s, for how long the value has been the same
        self._since = self._value = math.nan  # s, and rad
        self._change, self._run = 0.0, 0
        self._changes = self._turns = 0  # since a value was last repeated

    def take(self, now: float, value: float) -> None:
        """Take a reading; see `ReadingWatch.take`."""
        if value == self._value:
            self._run += 1
        else:
            if self._run:
                self._changes = self._turns = 0
            change = value - self._value
            self._turns += change * self._change < 0.0
            self._changes += 1
            self._run, self._since, self._value, self._change = 0, now, value, change
        self.still = now - self._since

    @property
    def has_ended(self) -> bool:
        """Whether the sensor is frozen."""
        noisy = self._changes >= _NOISY and self._turns >= _TURNING * self._changes
        return noisy and self.still >= _FROZEN and self._run >= _FROZEN_READINGS


def missing_speeds(missing: Sequence[str], age: float, level: Level) -> list[Fault]:
    """Return the fault that these speeds have not arrived in the time (s) since the activation."""
    sentence = (
        f"The {', '.join(missing)} did not arrive in the {age:.0f} s since the node was activated, "
        "so loads are not known; check topic and publisher, or fix the speed by its parameter, at "
        "0 if there is none."
    )
    return [Fault(level, sentence)] if missing else []


def turns_without_engine(pto: "SpeedWatch", engine: "SpeedWatch", now: float) -> list[Fault]:
    """Return the fault that a PTO turns for longer than it runs out after the engine stopped."""
    age, apart = now - max(pto.since, engine.since), now - min(pto.time, engine.time)
    if not (pto.turns and engine.turns is False and age > _RUN_OUT and apart <= _FRESH):
        return []
    sentence = (
        f"The {pto.name} is {pto.value:.4g} rpm, although the {engine.name} has been 0 for "
        f"{age:.0f} s, so one of both is wrong; check their sensors and units."
    )
    return [Fault(Level.WARN, sentence, since=now - age)]


class SpeedWatch:
    """Watches a speed of the tractor on a topic."""

    def __init__(self, source: Source, topic: str) -> None:
        self._source = source
        self.name = f"{source.label} speed on {topic}"
        self.value = self.time = math.nan  # the last value, and when it arrived, s
        self._age = 0.0  # s, of its stamp
        self.turns: bool | None = None  # whether it is no noise about 0; None if it is not known
        self.since = math.nan  # s, since when this is so
        self._window, self._recent = _Window(), Recent()
        self._agreement = Agreement(source.value)
        self._since = math.nan  # s, of the last plausible value
        self._passed = False
        # The value after the last large change, this change, and its time, s.
        self._level, self._change, self._changed = 0.0, 0.0, math.nan

    def take(self, now: float, value: float, sender: str = "", age: float = 0.0) -> None:
        """Take a value, rpm or m/s, at ``now`` (steady clock, s), when its stamp had an age, s."""
        low, high = _PLAUSIBLE[self._source]
        self._age = age
        # In another unit a shaft of a PTO never reaches 120; in rpm it passes there as it starts.
        self._passed = self._passed or (self._source is Source.PTO and low <= abs(value) <= high)
        low = 0.0 if self._passed else low
        resumed = not now - self.time <= _FRESH
        if resumed or value == 0.0 or low <= abs(value) <= high:
            self._since = now
        self._window.count(now)
        self._window.differing += self._agreement.take(round(1e9 * now), value)
        if sender:
            self._window.senders[sender] = value
        change = value - self._level
        if abs(change) >= _SWING[self._source]:
            to_and_fro = change * self._change < 0.0 and now - self._changed <= _SWING_TIME
            self._window.jumps += to_and_fro
            self._window.largest = max(self._window.largest, to_and_fro * abs(change))
            self._level, self._change, self._changed = value, change, now
        turns = None if math.isnan(value) else abs(value) > AGREEMENT[self._source.value][0]
        if turns is not self.turns or not now - self.time <= _RUN_OUT:
            self.turns, self.since = turns, now
        self.time, self.value = now, value

    @property
    def arrived(self) -> bool:
        """Whether the speed has ever arrived."""
        return not math.isnan(self.time)

    def judge(
        self, now: float, stale_after: float, publishers: _Nodes, delay: str = ""
    ) -> list[Fault]:
        """Return what was wrong since the last call; ``delay`` says why values may be late."""
        source, value, name = self._source, self.value, self.name
        window, self._window = self._window, _Window()
        age, problem, since = now - self.time, "", math.nan
        if age > stale_after:
            problem = f"The {name} stopped {age:.1f} s ago; {delay or 'check its publisher'}."
        elif self.arrived and not math.isfinite(value):
            problem = f"The {name} is {value}, so that it is not known; check its publisher."
        elif abs(self._age) > stale_after:
            apart = f"{abs(self._age):.3g} s {'old' if self._age > 0.0 else 'ahead'}"
            fix = f"synchronise the clocks, or set {source.value}_time to receipt"
            problem = f"The stamps of the {name} are {apart}, so that it is not known; {fix}."
        elif value < 0.0 and source is not Source.GROUND:
            problem = f"The {name} is negative ({value:g} rpm); publish its magnitude."
            since = window.began
        elif now - self._since > _IMPLAUSIBLE_AFTER:
            problem = (
                f"The {name} has been {value:.4g} {source.unit}, which is not plausible, for "
                f"{now - self._since:.0f} s; is it in {_OTHER_UNITS[source]}?"
            )
            # Of a starter and an engine that stalls, only the low speeds are not plausible.
            since = self._since if abs(value) < _PLAUSIBLE[source][0] else -math.inf
        faults = [Fault(Level.WARN, problem, since=since)] if problem else []
        disagreement = _disagreement(window, publishers, f"the {name}", source.value)
        if window.jumps >= _SWINGS and not (disagreement or delay):
            sentence = (
                f"The {name} changed to and fro by {window.largest:.4g} {source.unit} "
                f"{window.jumps} times in a second, which it cannot; check the sensor."
            )
            faults.append(Fault(Level.WARN, sentence, "swings", window.began))
        return self._recent.with_earlier(now, faults + disagreement)
