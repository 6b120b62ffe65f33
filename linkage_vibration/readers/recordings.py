# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads recordings of an accelerometer: CSV files of a phone, and bags with an IMU."""

import re
from pathlib import Path

import numpy as np

from linkage_vibration.bags.message_types import IMU
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.readers.stamps import even_samples
from linkage_vibration.support.atomic_files import read_text

_CHANNELS = [
    f"{part}.{axis}" for part in ("linear_acceleration", "angular_velocity") for axis in "xyz"
]
_FEWEST = 2  # columns of a CSV file: the time and one channel
_ONE_WAY = 0.9  # share of changes to one side above which a channel is a time or a counter
_ROUNDED = 0.01  # of the deviation of a channel: what rounding changes in a magnitude
_BACK = 0.5  # s, by which messages may overtake one another


class RecordingError(LinkageVibrationError):
    """A recording cannot be read."""


def read_recording(path: Path, topic: str | None = None) -> tuple[FloatArray, FloatArray]:
    """Return times (s), (n,), and signals, (n, n_channels), of a CSV file or an IMU in a bag."""
    if path.suffix.lower() == ".csv":
        table = read_numbers(path)
        if table.shape[1] < _FEWEST:
            problem = f"{path}: has {table.shape[1]} columns; give the time and a channel."
            raise RecordingError(problem)
        return ordered(path, table[:, 0], table[:, 1:])
    # A node that has no such libraries reads profiles of the ground here, but no bags.
    from linkage_vibration.bags.message_columns import header_stamps, read_columns, topic_types

    topics = [name for name, kind in topic_types(path).items() if kind == IMU]
    if topic is not None and topic not in topics:
        names = f"topics: {', '.join(topics)}" if topics else "no such topic"
        raise RecordingError(f"{path} has no {topic} of type {IMU}; it has {names}.")
    if topic is None and len(topics) != 1:
        fix = f"choose one with --topic: {', '.join(topics)}" if topics else "record an IMU"
        raise RecordingError(f"{path} has {len(topics)} topics of type {IMU}; {fix}.")
    name = topic or topics[0]
    columns = read_columns(path, {name: IMU})[name]
    signals = np.column_stack([columns[channel] for channel in _CHANNELS])
    # The times are those of measuring, or of recording without stamps.
    stamps = header_stamps(columns)
    times = stamps if stamps.any() else columns["log_time"].astype(np.int64)
    return ordered(path, np.asarray(1e-9 * (times - times[:1])), signals)


def vibrating(signals: FloatArray) -> tuple[FloatArray, list[str]]:
    """Return signals whose channels that show no vibration are 0, and what they are.

    The magnitude of other channels has sums and multiples of the frequencies of these.
    """
    kept, notes = signals.copy(), list[str]()
    for i in reversed(range(signals.shape[1])):
        channel, squares = signals[:, i], np.delete(kept, i, axis=1) ** 2
        steps = np.sign(np.diff(channel))
        weights = np.linalg.lstsq(squares, channel**2, rcond=None)[0]
        error = channel - np.sqrt(np.maximum(squares @ weights, 0.0))
        positive = channel.min() >= 0.0 and (weights > -_ROUNDED * weights.max(initial=0.0)).all()
        what = ""
        if abs(steps.sum()) > _ONE_WAY * np.abs(steps).sum():
            what = "changes in one direction, as a time or counter"
        elif positive and error.std() < _ROUNDED * channel.std():
            what = "is the magnitude of others, which is not linear"
        if what:
            kept[:, i] = 0.0
            notes.insert(0, f"channel {i + 1} {what}, and is left out.")
    return kept, notes


def shows_sides(path: Path) -> bool:
    """Return whether a recording may show motions along y: not if its titles name x or z alone."""
    if path.suffix.lower() != ".csv":
        return True
    titles = read_text(path, "utf-8-sig").partition("\n")[0].lower()
    axes = re.findall("(?<![a-z])[xyz](?![a-z])", titles)
    return not axes or "y" in axes


def read_numbers(path: Path) -> FloatArray:
    """Return the lines of `read_table`, (n, n_columns), without columns that are empty."""
    table = read_table(path)
    return np.hstack([table[:, :1], table[:, 1:][:, ~np.isnan(table[:, 1:]).all(axis=0)]])


def read_table(path: Path) -> FloatArray:
    """Return the lines of numbers of a CSV file, (n, n_columns); an empty cell is NaN."""
    try:
        text = read_text(path, "utf-8-sig")
    except UnicodeDecodeError:
        raise RecordingError(f"{path}: is not text in UTF-8; save it as CSV UTF-8.") from None
    except OSError as error:
        text = f"{path}: cannot be read ({error.strerror}); give a CSV file."
        raise RecordingError(text) from None
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
    middle = lines[len(lines) // 2][1] if lines else ""
    separator = next((mark for mark in ";\t" if mark in middle), ",")
    rows = list[list[float]]()
    for i, line in lines:
        # Where no comma separates, it is a decimal one.
        cells = (line if separator == "," else line.replace(",", ".")).split(separator)
        try:
            row = [_number(cell) for cell in cells]
        except ValueError:
            if not rows:  # names
                continue
            problem = f"line {i} is no line of numbers"
            raise RecordingError(f"{path}: {problem}; correct or delete it.") from None
        if rows and len(row) != len(rows[0]):
            problem = f"line {i} has {len(row)} columns, and those before it {len(rows[0])}"
            raise RecordingError(f"{path}: {problem}; correct or delete it.")
        rows.append(row)
    if not rows:
        hint = "give the time or distance, and what was measured"
        raise RecordingError(f"{path}: has no line of numbers; {hint}.")
    return np.array(rows)


def _number(cell: str) -> float:
    """Return the number in a cell; NaN if the cell is empty."""
    return float(cell.strip(' "') or "nan")


def ordered(path: Path, times: FloatArray, signals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what is finite in the order of its times, which are even if samples share stamps."""
    kept = np.isfinite(times) & np.isfinite(signals).all(axis=1)
    times, signals = times[kept], signals[kept]
    back = float(-np.diff(times).min(initial=0.0))
    if back > _BACK:
        problem = f"{path}: the times go back by {back:.3g} s; give one recording, in their order."
        raise RecordingError(problem)
    order = np.argsort(times, kind="stable")
    return even_samples(str(path), times[order], signals[order], RecordingError)
