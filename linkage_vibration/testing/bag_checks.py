# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Checks bags against limits, for the tests of a software stack."""

import math
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import datetime, timezone
from numbers import Real
from pathlib import Path

import numpy as np

from linkage_vibration.bags.blocks import Integers
from linkage_vibration.bags.message_columns import first_topic, topic_types
from linkage_vibration.bags.streams import open_bags
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.messages.topics import PREDICTION
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.inputs.presets import HITCH, PRESETS
from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.prediction.verdict import KNOWN, above_and_below, durations, not_counted
from linkage_vibration.review.log import Log, read_log
from linkage_vibration.review.picture import plot


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
        Least share of the drive for which it is known whether ``load_ratio`` is exceeded, 0 to 1;
        without that limit, it does not count.
    statuses : tuple of Status, optional
        The allowed statuses of predictions.
    gap : float, optional
        Longest allowed time between two predictions, s.
    latency : float, optional
        Longest allowed time between sending a reading and sending its prediction, s; only a log
        that the node recorded contains it.

    Raises
    ------
    TestKitError
        If a limit is negative or not a number, or a status is not a `Status`.
    """

    load_ratio: float | None = None
    known_share: float | None = KNOWN
    statuses: tuple[Status, ...] | None = (Status.OK,)
    gap: float | None = None
    latency: float | None = None

    def __post_init__(self) -> None:
        """Check the limits."""
        for name in ("load_ratio", "known_share", "gap", "latency"):
            value = getattr(self, name)
            number = isinstance(value, Real) and not isinstance(value, bool)
            if value is not None and not (number and 0.0 <= value < math.inf):
                raise TestKitError(f"{name} is {value!r}; give a number from 0, or None.")
        if self.known_share is not None and self.known_share > 1.0:
            raise TestKitError(f"known_share is {self.known_share}; give at most 1, or None.")
        for status in () if self.statuses is None else self.statuses:
            if status not in list(Status):
                raise TestKitError(f"statuses contains {status!r}; use Status, as Status.OK.")


@dataclass(frozen=True, slots=True)
class Failure:
    """A limit that was exceeded.

    Attributes
    ----------
    limit : str
        A field of `Limits`.
    time, seconds : int and float
        When it was exceeded most, or first if there is no degree: the stamp, ns, and the time since
        the first prediction of the bag, s.
    count, words : int and str
        How many times it was exceeded, and what happened then.
    """

    limit: str
    time: int
    seconds: float
    count: int
    words: str

    def __str__(self) -> str:
        """Return the failure as one line of text."""
        whole = datetime.fromtimestamp(self.time // 10**9, timezone.utc)
        utc = f"{whole:%Y-%m-%d %H:%M:%S}.{self.time % 10**9 // 10**6:03} UTC"
        times = "once" if self.count == 1 else f"{self.count} times"
        return f"{self.limit}: {self.words} at {self.seconds:.3f} s ({utc}); exceeded {times}"


@dataclass(frozen=True, slots=True)
class Report:
    """The result of a check.

    Attributes
    ----------
    bag : Path
    predictions : int
    failures : tuple of Failure
        The exceeded limits; empty if the bag passed.
    picture : Path or None
        The picture of the drive.
    """

    bag: Path
    predictions: int
    failures: tuple[Failure, ...]
    picture: Path | None

    @property
    def passed(self) -> bool:
        """Whether no limit was exceeded."""
        return not self.failures

    def __str__(self) -> str:
        """Return the report as text."""
        if self.passed:
            return f"{self.bag}: {self.predictions} predictions within their limits"
        lines = [f"{self.bag}: of {self.predictions} predictions", *map(str, self.failures)]
        if self.picture is not None:
            lines.append(f"picture: {self.picture}")
        return "\n  ".join(lines)


def check_bag(
    bag: str | Path,
    limits: Limits,
    settings: Parameters | None = None,
    picture: str | Path | None = None,
) -> Report:
    """Check a bag against limits.

    Parameters
    ----------
    bag : str or Path
        A log with predictions, or any other bag, which is then replayed.
    limits : Limits
    settings : Parameters, optional
        Replay the bag with these parameters, even if it has predictions.
    picture : str or Path, optional
        The PNG to write if a limit is exceeded; it shows the drive, as ``review --png`` does.

    Raises
    ------
    TestKitError
        If the bag lacks a quantity that a limit concerns.
    LinkageVibrationError
        If the bag cannot be read or replayed.
    """
    bag = Path(bag)
    with ExitStack() as stack:
        log = bag
        if settings is not None or not first_topic(topic_types(bag), PREDICTION):
            if limits.latency is not None:
                raise TestKitError(
                    f"{bag} must be replayed and has no latency; give a log that the node recorded."
                )
            folder = stack.enter_context(tempfile.TemporaryDirectory())
            log = Path(folder) / "replayed.mcap"
            replay([bag], log, settings)
        read = read_log(log)
        waits = np.empty(0) if limits.latency is None else latencies(bag, log)
        failures = _failures(bag, read, waits, limits)
        drawn = Path(picture) if failures and picture is not None else None
        if drawn is not None:
            plot(read, drawn)
    return Report(bag, len(read.stamps), tuple(failures), drawn)


def latencies(bag: Path, log: Path) -> FloatArray:
    """Return how long after its reading each prediction in the log of a bag was sent, s."""
    names = [f"/{preset.topic}" for preset in PRESETS[HITCH].values()]
    with open_bags([log]) as bags:
        # A log lists all topics of the node, even those without messages.
        inputs = [topic.name for topic in bags.topics if topic.name in names and topic.count]
        if len(inputs) != 1:
            raise TestKitError(
                f"{bag} has messages on {len(inputs)} of the topics {', '.join(names)}; the "
                "latency needs exactly one."
            )
        blocks = bags.blocks([*inputs, first_topic(topic_types(log), PREDICTION)])
        parts = [np.array([b.topics == 0, b.log_times, b.publish_times], int) for b in blocks]
    of_input, logged, published = np.concatenate(parts, axis=1)
    readings, predictions = of_input == 1, of_input == 0
    # The log time of a prediction is that of its reading.
    sent = dict(zip(logged[readings].tolist(), published[readings].tolist(), strict=True))
    logged, published = logged[predictions], published[predictions]
    begun = np.array([sent.get(time, np.nan) for time in logged.tolist()])
    if np.array_equal(logged, published):
        raise TestKitError(
            f"{bag} is a replay, which has no latency; give a log that the node recorded."
        )
    return np.asarray(1e-9 * (published - begun))


def _failures(bag: Path, log: Log, latency: FloatArray, limits: Limits) -> list[Failure]:
    """Return the exceeded limits in the order of time."""
    failures, drive = list[Failure](), log.drive
    loads = np.empty(0) if drive is None else drive.resonances.total_load_ratio.astype(float)
    load_stamps = log.stamps[:0] if drive is None else log.stamps[drive.predictions]

    def load(at: int) -> str:
        """Return the load ratio of a resonance in words, with its place and its main cause."""
        assert drive is not None
        of = drive.resonances.message(at)
        place, cause = of.total_load_place, of.excitation
        return f"the load ratio in {place} is {of.total_load_ratio:.2g} (most severe: {cause})"

    def add(limit: str, stamps: Integers, exceeded: BoolArray, at: int, words: str) -> None:
        time = int(stamps[at])
        then = int(np.searchsorted(load_stamps, time, "right")) - 1
        if limit not in ("load_ratio", "known_share") and then >= 0 and np.isfinite(loads[then]):
            words += f" ({load(then)})"
        seconds = 1e-9 * (time - int(log.stamps[0]))
        failures.append(Failure(limit, time, seconds, int(exceeded.sum()), words))

    if limits.statuses is not None:
        exceeded = ~np.isin(log.status, [int(status) for status in limits.statuses])
        if exceeded.any():
            at = int(exceeded.argmax())
            angle, status = math.degrees(log.crank_angle[at]), Status(int(log.status[at]))
            words = f"the status is {status.name} at a crank angle of {angle:.2f} deg"
            add("statuses", log.stamps, exceeded, at, words)
    if limits.load_ratio is not None and not np.isfinite(loads).any():
        if failures:
            return failures  # which may be why no load is known
        raise TestKitError(
            f"{bag} contains no load ratio: no speed is known, no excitation at work has an "
            "amplitude within the frequencies of the table; record engine_speed, pto_speed or "
            "ground_speed too, or give settings, with which the bag is replayed, such as a fixed "
            "speed."
        )
    if limits.load_ratio is not None and limits.known_share is not None:
        assert drive is not None
        share = durations(drive, limits.load_ratio).known_share
        if share < limits.known_share:
            unknown = ~np.logical_or(*above_and_below(drive, limits.load_ratio))
            words = f"it is known for {100.0 * share:.3g} % of the drive whether loads exceeded "
            words += f"{limits.load_ratio:g}, less than {100.0 * limits.known_share:g} % "
            why = not_counted(drive, log.excitations).rstrip(".")
            words += f"({why or 'messages are missing'}), first"
            add("known_share", load_stamps, np.ones(1, np.bool_), int(unknown.argmax()), words)
    gaps = 1e-9 * np.diff(log.stamps)
    checks: list[tuple[str, Integers, FloatArray, Callable[[int], str]]] = [
        ("load_ratio", load_stamps, loads, load),
        ("gap", log.stamps[:-1], gaps, lambda i: f"no prediction for {gaps[i]:.3f} s"),
        ("latency", log.stamps, latency, lambda i: f"a prediction took {latency[i]:.5f} s"),
    ]
    for limit, stamps, values, describe in checks:
        largest = getattr(limits, limit)
        if largest is not None and (exceeded := values > largest).any():
            at = int(np.nanargmax(values))
            add(limit, stamps, exceeded, at, f"{describe(at)}, more than {largest:g},")
    return sorted(failures, key=lambda failure: failure.time)
