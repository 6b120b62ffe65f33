# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A hundred thousand spoilt files: an error of ours or a valid result, and nothing else.

Run by `python -m benchmark.fuzz [INPUTS]`. Each reader works in a process of its own, with a limit
on its memory and on the time of each input. Inputs are numbered and seeded by their number, so that
one which failed is made again by `spoilt`.
"""

import contextlib
import multiprocessing
import os
import random
import resource
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

from tqdm import tqdm

from benchmark.file_readers import Files, Reader, all_readers
from benchmark.report import machine, publish, table
from benchmark.spoiling import spoil_file
from linkage_vibration.errors import LinkageVibrationError

INPUTS = 120_000
MEMORY = 4 * 2**30  # bytes of address space
GROWTH = 256 * 2**20  # bytes that reading a file of some kB may take
SECONDS = 60.0  # for one input, by the clock, on a machine that others share
START = 60.0  # s, for a process to begin

REFUSED, ACCEPTED = "refused", "accepted"
TRACEBACK, INVALID, GREEDY = "traceback", "invalid result", "too much memory"
HANG, CRASH = "hang", "crash"


@dataclass(slots=True)
class Tally:
    """What became of a reader's inputs."""

    outcomes: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)
    growth: int = 0  # bytes that memory grew beyond what unspoilt files take
    slowest: float = 0.0  # s of processor time


def spoilt(reader: Reader, number: int) -> tuple[str, Files]:
    """Return input ``number`` of a reader: the path to give, and the files, one of them spoilt."""
    rng = random.Random(f"{reader.name} {number}")
    main, files = reader.seeds[number % len(reader.seeds)]
    name = rng.choice(sorted(files))
    others = [seed[other] for _, seed in reader.seeds for other in seed]
    return main, {**files, name: spoil_file(name, files[name], others, rng)}


def write(folder: Path, files: Files) -> None:
    """Write files into a folder."""
    for name, content in files.items():
        (folder / name).write_bytes(content)


def outcome(reader: Reader, path: Path) -> tuple[str, str]:
    """Read a path; return what became of it, and the trace of what should not have."""
    try:
        reader.read(path)
    except LinkageVibrationError:
        return REFUSED, ""
    except AssertionError:
        return INVALID, traceback.format_exc()
    except Exception:
        return TRACEBACK, traceback.format_exc()
    return ACCEPTED, ""


def work(pipe: Connection, index: int, numbers: range) -> None:
    """Read a reader's inputs one by one and send what became of each, with time and memory."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    warnings.simplefilter("ignore")
    reader = all_readers()[index]
    with (
        tempfile.TemporaryDirectory() as place,
        open(os.devnull, "w") as nothing,
        contextlib.redirect_stdout(nothing),
        contextlib.redirect_stderr(nothing),
    ):
        folder = Path(place)
        for main, files in reader.seeds:
            write(folder, files)
            assert outcome(reader, folder / main) == (ACCEPTED, "")
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for number in numbers:
            main, files = spoilt(reader, number)
            write(folder, files)
            start = time.process_time()
            found, trace = outcome(reader, folder / main)
            spent = time.process_time() - start
            growth = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
            if growth > GROWTH:
                pipe.send((GREEDY, f"{growth} bytes more than unspoilt files take", spent, growth))
                return
            pipe.send((found, trace, spent, growth))


def fuzz(index: int, name: str, count: int, bar: "tqdm[None]") -> Tally:
    """Watch over a worker, and start another after each input that killed or stopped it."""
    context = multiprocessing.get_context("spawn")
    tally = Tally()
    number = 0
    while number < count:
        receiver, sender = context.Pipe(duplex=False)
        worker = context.Process(target=work, args=(sender, index, range(number, count)))
        worker.start()
        sender.close()
        patience = SECONDS + START
        while number < count:
            trace = ""
            if not receiver.poll(patience):
                found = HANG
            else:
                try:
                    found, trace, spent, growth = receiver.recv()
                    tally.slowest = max(tally.slowest, spent)
                    tally.growth = max(tally.growth, growth)
                except EOFError:
                    found = CRASH
            tally.outcomes[found] += 1
            if found not in (REFUSED, ACCEPTED):
                tally.failures.append(f"{name}, input {number}: {found}\n{trace}")
            number += 1
            patience = SECONDS
            bar.update()
            if found in (HANG, CRASH, GREEDY):
                break
        worker.kill()
        worker.join()
    return tally


def main() -> None:
    """Fuzz every reader and publish what became of the inputs."""
    names = [reader.name for reader in all_readers() if reader.seeds]  # all can be made
    total = int(sys.argv[1]) if len(sys.argv) > 1 else INPUTS
    count = -(-total // len(names))
    rows = []
    failures: list[str] = []
    with tqdm(total=count * len(names), unit="file") as bar:
        for index, name in enumerate(names):
            bar.set_description(name)
            tally = fuzz(index, name, count, bar)
            failures += tally.failures
            bad = [TRACEBACK, INVALID, CRASH, HANG, GREEDY]
            outcomes = [tally.outcomes[kind] for kind in (REFUSED, ACCEPTED, *bad)]
            numbers = [f"{n}" for n in (sum(outcomes), *outcomes)]
            rows.append([name, *numbers, f"{tally.growth / 2**20:.0f}", f"{tally.slowest:.2f}"])
    for failure in failures:
        print(failure, file=sys.stderr)
    columns = ["reader", "inputs", REFUSED, ACCEPTED, "tracebacks", "invalid results"]
    columns += ["crashes", "hangs", "too much memory", "memory grew by, MiB", "slowest, s"]
    told = (
        "Files that each reader accepts, spoilt in one place or a few: bits, bytes, integers, "
        "numbers, words, lines, pieces cut, repeated or taken from another file; members of "
        "archives and branches of YAML trees with everything around them intact. Refused: an error "
        f"of ours. An input may take {GROWTH / 2**20:.0f} MiB of memory, {MEMORY / 2**30:.0f} GiB "
        f"of addresses and {SECONDS:.0f} s; memory grew over that of reading the unspoilt files."
    )
    publish(
        "fuzz",
        "Spoilt files",
        [told, table(columns, rows)],
        machine("PyYAML", "pyuff", "meshio", "scikit-fem", "rosbags"),
    )
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
