# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Checks bags against limits, for the tests of a software stack."""

import io
import math
import tempfile
import textwrap
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import datetime, timezone
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.message_columns import Columns, first_topic, read_columns, topic_types
from linkage_vibration.bags.streams import open_bags
from linkage_vibration.drawing.palette import COLOURS, GREY, INK
from linkage_vibration.drawing.plots import plain
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.topics import PREDICTION, RESONANCE
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.inputs.presets import HITCH, PRESETS
from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.review.log import mode_label
from linkage_vibration.support.atomic_files import write_bytes

FloatArray = NDArray[np.float64]
Integers = NDArray[np.int64]

_AROUND = 5.0  # s that a picture shows before and after a moment
_LIMIT = "#CC3311"


class TestKitError(LinkageVibrationError):
    """A bag cannot be checked against a limit."""

    __test__ = False  # its name begins like that of a test


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits of a check; None switches a limit off.

    Attributes
    ----------
    margin : float, optional
        Smallest allowed relative margin between any excitation and natural frequency, 1.
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

    margin: float | None = None
    statuses: tuple[Status, ...] | None = (Status.OK,)
    gap: float | None = None
    latency: float | None = None

    def __post_init__(self) -> None:
        """Check the limits."""
        for name in ("margin", "gap", "latency"):
            value = getattr(self, name)
            number = isinstance(value, Real) and not isinstance(value, bool)
            if value is not None and not (number and 0.0 <= value < math.inf):
                raise TestKitError(f"{name} is {value!r}; give a number from 0, or None.")
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
        When it was exceeded most, or first if there is no degree: log time, ns, and time since the
        first prediction of the bag, s.
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
        The picture of the first failure.
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


@dataclass(frozen=True, slots=True, eq=False)
class _Signals:
    """The checked quantities, by columns."""

    time: Integers  # (n,), ns, of predictions
    crank_angle: FloatArray  # deg
    status: Integers
    margin_time: Integers  # (m,), ns, of resonances
    margin: FloatArray  # 1, NaN where stale
    excitation: NDArray[np.object_]
    mode: NDArray[np.object_]  # (m,), its number from 1 and its name
    latency: FloatArray  # (n,), s, NaN if the reading is not in the log


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
        The PNG to write if a limit is exceeded; it shows the moment of the first failure.

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
        signals = _signals(bag, log, limits)
    failures = _failures(signals, limits)
    drawn = Path(picture) if failures and picture is not None else None
    if drawn is not None:
        _draw(bag, signals, limits, failures[0], drawn)
    return Report(bag, len(signals.time), tuple(failures), drawn)


def _signals(bag: Path, log: Path, limits: Limits) -> _Signals:
    types = topic_types(log)
    prediction, resonance = first_topic(types, PREDICTION), first_topic(types, RESONANCE)
    columns = read_columns(log, {name: types[name] for name in (prediction, resonance) if name})
    predictions: Columns = columns[prediction]
    if not len(predictions.get("log_time", ())):
        raise TestKitError(f"{bag} holds no prediction; was the joint ever published?")
    resonances = columns.get(resonance, {})
    if limits.margin is not None and not len(resonances.get("log_time", ())):
        raise TestKitError(
            f"{bag} contains no margin, as no speed is known; record engine_speed, pto_speed or "
            "ground_speed too, or give a fixed speed in the settings."
        )
    n = len(predictions["log_time"])
    label = mode_label(log, str(predictions["table_id"][-1]))
    modes = resonances.get("mode", np.empty(0, np.int64)).tolist()
    labels = {mode: label(mode) for mode in set(modes)}
    return _Signals(
        predictions["log_time"],
        np.rad2deg(predictions["crank_angle"]),
        predictions["status"].astype(np.int64),
        resonances.get("log_time", np.empty(0, np.int64)),
        np.abs(resonances.get("relative_margin", np.empty(0))),
        resonances.get("excitation", np.empty(0, object)),
        np.array([labels[mode] for mode in modes], object),
        np.full(n, np.nan) if limits.latency is None else _latencies(bag, log, types),
    )


def _latencies(bag: Path, log: Path, types: Mapping[str, str]) -> FloatArray:
    """Return how long after its reading each prediction was sent, s."""
    names = [f"/{preset.topic}" for preset in PRESETS[HITCH].values()]
    with open_bags([log]) as bags:
        # A log lists all topics of the node, even those without messages.
        inputs = [topic.name for topic in bags.topics if topic.name in names and topic.count]
        if len(inputs) != 1:
            raise TestKitError(
                f"{bag} has messages on {len(inputs)} of the topics {', '.join(names)}; the "
                "latency needs exactly one."
            )
        blocks = bags.blocks([*inputs, first_topic(types, PREDICTION)])
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


def _failures(signals: _Signals, limits: Limits) -> list[Failure]:
    """Return the exceeded limits in the order of time."""
    failures: list[Failure] = []

    def add(limit: str, times: Integers, exceeded: NDArray[np.bool_], at: int, words: str) -> None:
        time = int(times[at])
        then = int(np.searchsorted(signals.margin_time, time, "right")) - 1
        if limit != "margin" and then >= 0 and np.isfinite(signals.margin[then]):
            words += f" ({_nearest(signals, then)})"
        seconds = 1e-9 * (time - int(signals.time[0]))
        failures.append(Failure(limit, time, seconds, int(exceeded.sum()), words))

    if limits.statuses is not None:
        exceeded = ~np.isin(signals.status, [int(status) for status in limits.statuses])
        if exceeded.any():
            at = int(exceeded.argmax())
            angle, status = signals.crank_angle[at], Status(int(signals.status[at]))
            words = f"the status is {status.name} at a crank angle of {angle:.2f} deg"
            add("statuses", signals.time, exceeded, at, words)
    if limits.margin is not None:
        exceeded = signals.margin < limits.margin
        if exceeded.any():
            at = int(np.nanargmin(signals.margin))
            words = f"{_nearest(signals, at)}, less than {100 * limits.margin:g} %"
            add("margin", signals.margin_time, exceeded, at, words)
    if limits.gap is not None:
        gaps = 1e-9 * np.diff(signals.time)
        exceeded = gaps > limits.gap
        if exceeded.any():
            at = int(gaps.argmax())
            words = f"no prediction for {gaps[at]:.3f} s, more than {limits.gap:g} s,"
            add("gap", signals.time[:-1], exceeded, at, words)
    if limits.latency is not None:
        exceeded = signals.latency > limits.latency
        if exceeded.any():
            at = int(np.nanargmax(signals.latency))
            words = (
                f"a prediction took {1e3 * signals.latency[at]:.2f} ms, more than "
                f"{1e3 * limits.latency:g} ms,"
            )
            add("latency", signals.time, exceeded, at, words)
    return sorted(failures, key=lambda failure: failure.time)


def _nearest(signals: _Signals, at: int) -> str:
    """Return in words which excitation and mode are nearest to each other in a resonance."""
    distance = f"{100 * signals.margin[at]:.2f} %"
    return f"{signals.excitation[at]} is {distance} from {signals.mode[at]}"


_Row = tuple[str, Integers, FloatArray, float | None]
"""Label, times (ns), values and limit of a row of a picture."""


def _rows(signals: _Signals, limits: Limits, failure: Failure) -> Iterator[_Row]:
    """Yield the rows that have something to show around a failure."""
    yield "crank angle [deg]", signals.time, signals.crank_angle, None
    if np.isfinite(_around(failure, signals, signals.margin_time, signals.margin)[1]).any():
        margin = limits.margin and 100.0 * limits.margin
        yield "margin [%]", signals.margin_time, 100.0 * signals.margin, margin
    gaps, gap = 1e-6 * np.diff(signals.time).astype(float), limits.gap and 1e3 * limits.gap
    yield "since the last\nprediction [ms]", signals.time[1:], gaps, gap
    if limits.latency is not None:
        yield "latency [ms]", signals.time, 1e3 * signals.latency, 1e3 * limits.latency


def _around(
    failure: Failure, signals: _Signals, times: Integers, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the values around a failure, and their times since the first prediction, s."""
    seconds = 1e-9 * (times - signals.time[0])
    near = np.abs(seconds - failure.seconds) <= _AROUND
    return seconds[near], values[near]


def _label(ax: Any, label: str) -> None:
    ax.set_ylabel(label)
    ax.grid(color="#dddddd", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(colors=GREY)


def _draw(bag: Path, signals: _Signals, limits: Limits, failure: Failure, picture: Path) -> None:
    """Draw the signals around a failure."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise TestKitError(
            "Drawing needs matplotlib; `pip install linkage_vibration[plots]`."
        ) from None

    rows = list(_rows(signals, limits, failure))
    figure = Figure(figsize=(10, 1.2 + 1.9 * len(rows)), dpi=120, layout="constrained")
    axes: NDArray[np.object_] = figure.subplots(len(rows), sharex=True, squeeze=False)[:, 0]
    for ax, (label, times, values, limit) in zip(axes, rows, strict=True):
        seconds, near = _around(failure, signals, times, values)
        ax.plot(seconds, near, color=COLOURS[0], linewidth=1.4, marker=".", markersize=2)
        if limit is not None:
            ax.axhline(limit, color=_LIMIT, linewidth=1.2, linestyle=(0, (4, 3)))
            place = {"xycoords": ("axes fraction", "data"), "ha": "right", "va": "bottom"}
            ax.annotate("limit", (0.995, limit), color=_LIMIT, **place)
        ax.axvline(failure.seconds, color=INK, linewidth=1.0)
        then = int(np.searchsorted(signals.margin_time, failure.time, "right")) - 1
        if values.size and label.startswith("margin") and then >= 0:
            about = f" {signals.excitation[then]}, {signals.mode[then]}"
            ax.annotate(plain(about), (failure.seconds, 0.9), xycoords=("data", "axes fraction"))
        if ax is not axes[0]:
            ax.set_ylim(bottom=0.0)
        _label(ax, label)
    wrong = limits.statuses is not None and ~np.isin(signals.status, limits.statuses)
    angles = np.where(wrong, signals.crank_angle, np.nan)
    seconds, bad = _around(failure, signals, signals.time, angles)
    axes[0].plot(seconds, bad, ".", color=_LIMIT, markersize=5)
    axes[-1].set_xlabel("time since the first prediction [s]")
    last = 1e-9 * (signals.time[-1] - signals.time[0])
    first = max(failure.seconds - _AROUND, -0.02 * _AROUND)
    axes[-1].set_xlim(first, max(min(failure.seconds + _AROUND, last), first + 0.1))
    title = textwrap.fill(f"{bag.name}, {failure}", 120)
    figure.suptitle(plain(title), x=0.01, horizontalalignment="left", fontsize=10)
    png = io.BytesIO()
    figure.savefig(png, format="png")
    write_bytes(picture, png.getvalue(), TestKitError)
