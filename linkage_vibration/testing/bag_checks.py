# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Checks bags against limits, for the tests of a software stack."""

import math
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from linkage_vibration.bags.message_columns import first_topic, topic_types
from linkage_vibration.bags.streams import open_bags
from linkage_vibration.errors import printable
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.messages.topics import PREDICTION
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.inputs.presets import HITCH, PRESETS
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.prediction.severity import listing
from linkage_vibration.review.difference import compare, problems, sentence
from linkage_vibration.review.log import Log, read_log
from linkage_vibration.review.picture import plot
from linkage_vibration.testing.limits import OF_LOADS, Limits, TestKitError
from linkage_vibration.testing.quantities import quantities, total_words


@dataclass(frozen=True, slots=True)
class Failure:
    """A limit that was exceeded.

    Attributes
    ----------
    limit : str
        A field of `Limits`, or "baseline".
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
        times = f"; exceeded {self.count} times" if self.count > 1 else ""
        return printable(f"{self.limit}: {self.words} at {self.seconds:.3f} s ({utc}){times}")


@dataclass(frozen=True, slots=True)
class Report:
    """The result of a check.

    Attributes
    ----------
    bag : Path
    predictions : int
    failures : tuple of Failure
        The exceeded limits, of which the first may cause others; empty if the bag passed.
    picture : Path or None
        The picture of the drive.
    checked : tuple of str
        The limits that were checked.
    input_faults : tuple of str
        A sentence for each fault of the inputs that the limits allow.
    """

    bag: Path
    predictions: int
    failures: tuple[Failure, ...]
    picture: Path | None
    checked: tuple[str, ...] = ()
    input_faults: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether no limit was exceeded."""
        return not self.failures

    def __str__(self) -> str:
        """Return the report as text."""
        lines = [f"{self.bag}: of {self.predictions} predictions", *map(str, self.failures)]
        if self.passed:
            lines = [f"{self.bag}: {self.predictions} predictions within their limits"]
            lines[0] += ", but the inputs are doubtful:" * bool(self.input_faults)
        lines += self.input_faults
        if self.picture is not None:
            lines.append(f"picture: {self.picture}")
        return "\n  ".join(lines)


def check_bag(
    bag: str | Path,
    limits: Limits,
    settings: Parameters | None = None,
    picture: str | Path | None = None,
    baseline: str | Path | None = None,
) -> Report:
    """Check a bag against limits, and against an earlier log.

    Parameters
    ----------
    bag : str or Path
        A log with predictions, or any other bag, which is then replayed.
    limits : Limits
    settings : Parameters, optional
        Replay the bag with these parameters, even if it has predictions.
    picture : str or Path, optional
        The PNG to write if a limit is exceeded; it shows the drive, as ``review --png`` does.
    baseline : str or Path, optional
        A log of the same drive; a difference of the predictions by more than the
        ``baseline_tolerance`` of the limits is a failure.

    Raises
    ------
    TestKitError
        If the log has no such excitation, place, mode or latency.
    LinkageVibrationError
        If the bag cannot be read or replayed, or the baseline has another drive.
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
        checked, failures = _failures(read, limits, waits)
        if baseline is not None:
            checked.append("baseline")
            failures += _changes(Path(baseline), read, limits.baseline_tolerance or 0.0)
        drawn = Path(picture) if failures and picture is not None else None
        if drawn is not None:
            plot(read, drawn)
    refused = any(failure.limit == "input_faults" for failure in failures)
    faults = () if refused else read.input_faults
    return Report(bag, len(read.stamps), tuple(failures), drawn, tuple(checked), faults)


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


def _failures(log: Log, limits: Limits, latency: FloatArray) -> tuple[list[str], list[Failure]]:
    """Return the limits that were checked, and those that were exceeded; causes come first."""
    found = list(quantities(log, limits, latency))
    failures, of_loads = list[Failure](), list[Failure]()
    for each in found:
        if each.exceeded.any():
            sizes = np.where(each.exceeded, np.nan_to_num(each.size), -np.inf)
            at, count = int(sizes.argmax()), int(each.exceeded.sum())
            words, row = each.words(at), int(each.predictions[at])
            if each.limit not in ("load_ratio", "input_faults"):
                words += _load_then(log, row)
            these = of_loads if each.limit in OF_LOADS else failures
            these.append(_failure(log, each.limit, row, count, words))
    unsure = min(found, key=lambda each: each.known_share, default=None)
    if unsure is not None and unsure.known_share < (limits.known_share or 0.0):
        share = max(0, math.floor(round(1000.0 * unsure.known_share, 6))) / 10.0
        words = f"it is known for {share:g} % of the drive whether {unsure.limit} is exceeded"
        words += f", less than {100.0 * limits.known_share:g} %" if limits.known_share else ""
        row = int(unsure.predictions[unsure.unknown]) if len(unsure.predictions) else 0
        failures.append(_failure(log, "known_share", row, 1, f"{words} ({unsure.why}), first"))
    return [*dict.fromkeys(each.limit for each in found)], failures + of_loads


def _failure(log: Log, limit: str, row: int, count: int, words: str) -> Failure:
    """Return a failure at a prediction of a log."""
    return Failure(limit, int(log.stamps[row]), float(log.times[row]), count, words)


def _load_then(log: Log, row: int) -> str:
    """Return the load at a prediction of a log as the end of a sentence, if it is known."""
    if log.drive is None:
        return ""
    then = int(np.searchsorted(log.drive.predictions, row, "right")) - 1
    known = then >= 0 and np.isfinite(log.drive.resonances.total_load_ratio[then])
    return f" while {total_words(log.drive, then)}," if known else ""


def _changes(baseline: Path, log: Log, tolerance: float) -> list[Failure]:
    """Return a failure if a log differs from an earlier one, which has to be of the same drive."""
    delta = compare(baseline, log.path)
    if not problems(delta, tolerance):
        return []
    differ = delta.a.status[delta.rows_a] != delta.b.status[delta.rows_b]
    for each in delta.quantities:
        differ |= each.beyond(tolerance)
    names = [each.name for each in delta.quantities if each.beyond(tolerance).any()]
    beyond = f" by more than {100.0 * tolerance:g} % in {listing(names)}" if names else ""
    changed = np.ones(len(log.stamps), np.bool_)
    changed[delta.rows_b] = differ
    what = sentence(delta).rstrip(".")
    words = f"the log (B) differs from {baseline} (A){beyond}: {what}, first"
    return [_failure(log, "baseline", int(changed.argmax()), int(changed.sum()), words)]
