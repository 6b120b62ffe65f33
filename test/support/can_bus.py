# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Frames of a CAN bus for tests: recorded ones, synthetic ones, and logs of both."""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

RECORDED = Path(__file__).parents[3] / "shared" / "data" / "tractor_can_gears.csv"
EPOCH = 1_700_000_000 * 10**9
"""Where the times of the recorded frames begin here, ns; the file counts them from 0."""


@dataclass(frozen=True)
class BusFrame:
    """A frame: time in ns, identifier, data, and its flags."""

    time: int
    identifier: int
    data: bytes
    extended: bool = True
    channel: str = "can0"


def identifier(group: int, source: int = 0, priority: int = 3) -> int:
    """Return the identifier of a frame of J1939 that is sent to all."""
    return priority << 26 | group << 8 | source


def recorded_frames() -> list[BusFrame]:
    """Return the frames of a real tractor; they contain no hitch position."""
    if not RECORDED.is_file():
        pytest.skip(f"{RECORDED} is missing")
    actual = []
    with RECORDED.open(newline="") as file:
        for row in csv.DictReader(file):
            group = int(row["pgn"])
            if group >> 8 & 0xFF < 0xF0:
                group |= int(row["destination"])
            number = identifier(group, int(row["source"]), int(row["priority"]))
            time = EPOCH + round(float(row["time"]) * 1e6)
            actual.append(BusFrame(time, number, bytes.fromhex(row["data"])))
    return actual


def synthetic_hitch(times: Sequence[int], raw: Sequence[int], source: int = 0xF0) -> list[BusFrame]:
    """Return rear hitch positions in steps of 0.4 %, as no tractor has sent them."""
    return [
        BusFrame(time, identifier(65093, source), bytes([value]) + 7 * b"\xff")
        for time, value in zip(times, raw, strict=True)
    ]


def write_candump(path: Path, frames: Iterable[BusFrame]) -> Path:
    """Write a log as `candump -L` does, in the order of times."""
    lines = []
    for frame in sorted(frames, key=lambda frame: frame.time):
        seconds, rest = divmod(frame.time, 10**9)
        width = 8 if frame.extended else 3
        text = f"{frame.identifier:0{width}X}#{frame.data.hex().upper()}"
        lines.append(f"({seconds}.{rest // 1000:06d}) {frame.channel} {text}\n")
    path.write_text("".join(lines))
    return path
