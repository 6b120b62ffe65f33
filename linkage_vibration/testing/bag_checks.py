# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Checks bags against limits, for the tests of a software stack."""

import math
import tempfile
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from linkage_vibration.bags.message_columns import first_topic, topic_types
from linkage_vibration.bags.streams import open_bags
from linkage_vibration.errors import check_type, printable
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
    check_type(limits, "give the limits as `Limits`", Limits)
    if limits.latency is not None and settings is not None:
        raise TestKitError(f"{bag} is replayed, which has no latency; leave out the settings.")
    return check_log(read_drive(bag, settings), limits, picture, baseline)


def read_drive(bag: str | Path, settings: Parameters | None = None) -> Log:
    """Return the log of a bag, which is replayed if it lacks predictions or settings are given."""
    if settings is None and first_topic(topic_types(Path(bag)), PREDICTION):
        return read_log(bag)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "replayed.mcap"
        replay([bag], log, settings)
        return replace(read_log(log), path=Path(bag))


def check_log(
    log: Log, limits: Limits, picture: str | Path | None = None, baseline: str | Path | None = None
) -> Report:
    """Check a log that `read_drive` has read, as `check_bag` does."""
    waits = np.empty(0) if limits.latency is None else latencies(log.path)
    checked, failures = _failures(log, limits, waits)
    if baseline is not None:
        checked.append("baseline")
        failures += _changes(read_log(baseline), log, limits.baseline_tolerance or 0.0)
    drawn = Path(picture) if failures and picture is not None else None
    if drawn is not None:
        plot(log, drawn)
    refused = any(failure.limit == "input_faults" for failure in failures)
    found = tuple(failures), drawn, tuple(checked), () if refused else log.input_faults
    return Report(log.path, len(log.stamps), *found)


def latencies(bag: Path) -> FloatArray:
    """Return how long after its reading each prediction in a log was sent, s."""
    hint = "give a log that the node recorded"
    names = [f"/{preset.topic}" for preset in PRESETS[HITCH].values()]
    if not (topic := first_topic(topic_types(bag), PREDICTION)):
        raise TestKitError(f"{bag} must be replayed and has no latency; {hint}.")
    with open_bags([bag]) as bags:
        # A log lists all topics of the node, even those without messages.
        inputs = [topic.name for topic in bags.topics if topic.name in names and topic.count]
        if len(inputs) != 1:
            raise TestKitError(
                f"{bag} has messages on {len(inputs)} of the topics {', '.join(names)}; the "
                "latency needs exactly one."
            )
        blocks = bags.blocks([*inputs, topic])
        parts = [np.array([b.topics == 0, b.log_times, b.publish_times], int) for b in blocks]
    of_input, logged, published = np.concatenate(parts, axis=1)
    readings, predictions = of_input == 1, of_input == 0
    # The log time of a prediction is that of its reading.
    sent = dict(zip(logged[readings].tolist(), published[readings].tolist(), strict=True))
    logged, published = logged[predictions], published[predictions]
    if np.array_equal(logged, published):
        raise TestKitError(f"{bag} is a replay, which has no latency; {hint}.")
    begun = np.array([sent.get(time, np.nan) for time in logged.tolist()])
    return np.asarray(1e-9 * (published - begun))


def _failures(log: Log, limits: Limits, latency: FloatArray) -> tuple[list[str], list[Failure]]:
    """Return the limits that were checked, and those that were exceeded; causes come first."""
    found = list(quantities(log, limits, latency))
    failures, of_loads = list[Failure](), list[Failure]()
    for each in found:
        if each.exceeded.any():
            sizes = np.where(each.exceeded, np.nan_to_num(each.size), -np.inf)
            at, row = int(sizes.argmax()), int(each.span.predictions[sizes.argmax()])
            words = each.words(at)
            if each.limit not in ("load_ratio", "input_faults"):
                words += _load_then(log, row)
            these = of_loads if each.limit in OF_LOADS else failures
            these.append(_failure(log, each.limit, row, int(each.exceeded.sum()), words))
    unsure = min(found, key=lambda each: each.known_share, default=None)
    if unsure is not None and unsure.known_share < (limits.known_share or 0.0):
        share = max(0, math.floor(round(1000.0 * unsure.known_share, 6))) / 10.0
        words = f"it is known for {share:g} % of the drive whether {unsure.limit} is exceeded"
        words += f", less than {100.0 * (limits.known_share or 0.0):g} % ({unsure.why}), first"
        rows = unsure.span.predictions[~np.asarray(unsure.known)]
        failures.append(_failure(log, "known_share", int(rows[0]) if len(rows) else 0, 1, words))
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


def _changes(baseline: Log, log: Log, tolerance: float) -> list[Failure]:
    """Return a failure if a log differs from an earlier one, which has to be of the same drive."""
    delta = compare(baseline, log)
    if not problems(delta, tolerance):
        return []
    beyond = {each.name: each.beyond(tolerance) for each in delta.quantities}
    names = [name for name, rows in beyond.items() if rows.any()]
    which = f" by more than {100.0 * tolerance:g} % in {listing(names)}" if names else ""
    changed = np.ones(len(log.stamps), np.bool_)
    changed[delta.rows_b] = np.any([delta.other_status, *beyond.values()], axis=0)
    what = sentence(delta).rstrip(".")
    words = f"the log (B) differs from {baseline.path} (A){which}: {what}, first"
    return [_failure(log, "baseline", int(changed.argmax()), int(changed.sum()), words)]
