# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Kills recording processes at random moments and counts what is lost and what is recovered.

`python -m benchmark.crash [KILLS]` starts the processes. Each records one topic at 1 kHz; a message
holds its number and the time at which it was written. SIGKILL ends the process between 0.1 s and
3 s after its log appeared. Files are split every second, so that some kills happen during a split.
"""

import itertools
import multiprocessing
import random
import struct
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from tqdm import tqdm

from benchmark.report import machine, publish, table
from linkage_vibration.bags.recorder import LogLimits, Provenance, Recorder
from linkage_vibration.bags.recovery import recover
from linkage_vibration.bags.writing import Attachment, Topic

KILLS = 200
PERIOD = 1e-3  # s
SPLIT = 1.0  # s
SHORTEST, LONGEST = 0.1, 3.0  # s from the log's appearance to the kill
AT_ONCE = 4  # children
_BODY = struct.Struct("<4xQQ")  # time of writing, number


@dataclass(frozen=True, slots=True)
class Outcome:
    """The files of one killed process.

    Attributes
    ----------
    lost : float
        Time from the last recovered message to the kill, s; from the first file's appearance if
        there is no message.
    holes : int
        Messages that are missing before the last recovered one.
    messages : int
        Recovered messages.
    files, unfinished : int
        All files, and those that had to be recovered.
    """

    lost: float
    holes: int
    messages: int
    files: int
    unfinished: int


def record(folder: Path) -> None:
    """Record until the process is killed."""
    topic = Topic("/numbers", "made_up/msg/Number", "uint64 time\nuint64 number\n", "", "")
    provenance = Provenance((Attachment("table.npz", "application/x-npz", bytes(100_000)),))
    recorder = Recorder(folder, [topic], provenance, LogLimits(split_duration=SPLIT))
    recorder.start()
    for number in itertools.count():
        now = time.time_ns()
        recorder.write([(topic.name, _BODY.pack(now, number), now, now)])
        time.sleep(PERIOD)


def kill(seed: int) -> Outcome:
    """Start a recording process, kill it, and return the outcome."""
    draw = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        process = multiprocessing.get_context("spawn").Process(target=record, args=(folder,))
        process.start()
        while not any(folder.iterdir()):
            time.sleep(0.001)
        appeared = time.time_ns()
        time.sleep(draw.uniform(SHORTEST, LONGEST))
        killed = time.time_ns()
        process.kill()
        process.join()
        return outcome(folder, appeared, killed)


def outcome(folder: Path, appeared: int, killed: int) -> Outcome:
    """Recover the unfinished files, and read all files with rosbags."""
    files = list(folder.glob("*.mcap"))
    unfinished = [path for path in files if not _is_complete(path)]
    bodies = []
    for path in files:
        whole = path
        if path in unfinished:
            whole = path.with_suffix(".recovered.mcap")
            recover(path, whole)
        with AnyReader([whole]) as reader:
            bodies += [_BODY.unpack(data) for _, _, data in reader.messages()]
    times = [body[0] for body in bodies]
    numbers = {body[1] for body in bodies}
    return Outcome(
        lost=1e-9 * (killed - max([appeared, *times])),
        holes=max(numbers, default=-1) + 1 - len(numbers),
        messages=len(bodies),
        files=len(files),
        unfinished=len(unfinished),
    )


def _is_complete(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return make_reader(file).get_summary() is not None
    except (McapError, struct.error):
        return False


def main() -> None:
    """Kill as many processes as the command line says, and publish what was lost."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else KILLS
    with ThreadPoolExecutor(AT_ONCE) as pool:
        outcomes = list(tqdm(pool.map(kill, range(count)), total=count, unit="kill"))
    lost = np.array([each.lost for each in outcomes])
    rows = [
        ["kills", str(count)],
        ["messages recovered", str(sum(each.messages for each in outcomes))],
        [
            "files, and how many of them were unfinished",
            _of(outcomes, "files") + ", " + _of(outcomes, "unfinished"),
        ],
        ["messages missing before the last one", _of(outcomes, "holes")],
        ["time lost, median, s", f"{np.median(lost):.3f}"],
        ["time lost, worst, s", f"{lost.max():.3f}"],
        ["kills that lost more than 1 s", str(np.count_nonzero(lost > 1.0))],
    ]
    text = (
        "This page shows how much of a recording is lost when its process is killed. Each process "
        f"records a message of 20 bytes about every {1e3 * PERIOD:g} ms, with an attachment of "
        f"100 kB and a new file every {SPLIT:g} s. SIGKILL ends it between {SHORTEST:g} s and "
        f"{LONGEST:g} s after its first file appeared; {AT_ONCE} processes run at once. Then each "
        "unfinished file is recovered, and rosbags reads all files. The lost time is from the last "
        "recovered message to the kill, or from the first file's appearance if there is no message."
    )
    publish(
        "crash",
        "Recordings that are killed",
        [text, table(["", "found"], rows)],
        machine("mcap", "rosbags"),
    )


def _of(outcomes: list[Outcome], name: str) -> str:
    return str(sum(getattr(each, name) for each in outcomes))


if __name__ == "__main__":
    main()
