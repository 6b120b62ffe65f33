# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Recording is killed at a random moment, again and again: what is lost, and what is recovered.

Run by `python -m benchmark.crash [KILLS]`. Each child records one topic at 1 kHz, a message every
millisecond that holds the time at which it was written and its number, and is killed by SIGKILL
between 0.1 s and 3 s after its log appeared. Files are split every second, so that kills hit
splits too.
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
from linkage_vibration.bags.recorder import Limits, Provenance, Recorder
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
    """What a kill left.

    Attributes
    ----------
    lost : float
        From the last message that is left, or else the first file's appearance, to the kill, s.
    holes : int
        Messages that are missing before that one.
    messages : int
        Messages that are left.
    files, unfinished : int
        Files, and how many of them had to be recovered.
    """

    lost: float
    holes: int
    messages: int
    files: int
    unfinished: int


def record(folder: Path) -> None:
    """Record for ever."""
    topic = Topic("/numbers", "made_up/msg/Number", "uint64 time\nuint64 number\n", "", "")
    provenance = Provenance((Attachment("table.npz", "application/x-npz", bytes(100_000)),))
    recorder = Recorder(folder, [topic], provenance, Limits(split_duration=SPLIT))
    recorder.start()
    for number in itertools.count():
        now = time.time_ns()
        recorder.write(topic.name, _BODY.pack(now, number), now, now)
        time.sleep(PERIOD)


def kill(seed: int) -> Outcome:
    """Let a process record, kill it, and see what is left."""
    draw = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        process = multiprocessing.get_context("spawn").Process(target=record, args=(folder,))
        process.start()
        while not any(folder.iterdir()):
            time.sleep(0.001)
        begun = time.time_ns()
        time.sleep(draw.uniform(SHORTEST, LONGEST))
        killed = time.time_ns()
        process.kill()
        process.join()
        return outcome(folder, begun, killed)


def outcome(folder: Path, begun: int, killed: int) -> Outcome:
    """Recover the files that need it, and read all of them by rosbags."""
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
        lost=1e-9 * (killed - max([begun, *times])),
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
    """Kill as often as the command line says, and publish what was lost."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else KILLS
    with ThreadPoolExecutor(AT_ONCE) as pool:
        outcomes = list(tqdm(pool.map(kill, range(count)), total=count, unit="kill"))
    lost = np.array([each.lost for each in outcomes])
    rows = [
        ["kills", str(count)],
        ["messages recovered", str(sum(each.messages for each in outcomes))],
        [
            "files, and of them unfinished",
            _of(outcomes, "files") + ", " + _of(outcomes, "unfinished"),
        ],
        ["messages missing before the last one", _of(outcomes, "holes")],
        ["time lost, median, s", f"{np.median(lost):.3f}"],
        ["time lost, worst, s", f"{lost.max():.3f}"],
        ["kills that cost more than 1 s", str(np.count_nonzero(lost > 1.0))],
    ]
    text = (
        f"Each process records a message of 20 bytes every {1e3 * PERIOD:g} ms or so, with an "
        f"attachment of 100 kB and a new file every {SPLIT:g} s. It is killed by SIGKILL between "
        f"{SHORTEST:g} s and {LONGEST:g} s after its first file appeared; {AT_ONCE} run at once. "
        "Each unfinished file is recovered then, and rosbags reads them all. Lost is the time from "
        "the last message that is left, or else the first file, to the kill."
    )
    publish(
        "crash",
        "Recording, killed at a random moment",
        [text, table(["", "found"], rows)],
        machine("mcap", "rosbags"),
    )


def _of(outcomes: list[Outcome], name: str) -> str:
    return str(sum(getattr(each, name) for each in outcomes))


if __name__ == "__main__":
    main()
