# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads 100,000 damaged files: each must give an error of the package or a valid result.

`python -m benchmark.fuzz [INPUTS]` runs each reader in its own process, with a limit on its memory
and on the time of each input. The number of an input is the seed of its damage, so `damaged` makes
an input that failed once more.
"""

import contextlib
import multiprocessing
import os
import resource
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

from tqdm import tqdm

from benchmark.report import machine, publish, table
from test.support.damage import (
    ACCEPTED,
    INVALID,
    REFUSED,
    TRACEBACK,
    damaged,
    read_outcome,
    write_files,
)
from test.support.file_readers import all_readers

INPUTS = 120_000
MEMORY = 4 * 2**30  # bytes of address space
GROWTH = 256 * 2**20  # bytes that reading a file of a few kB may take
SECONDS = 60.0  # of wall-clock time for one input; other processes may use the machine, too
START = 60.0  # s, for the start of a process

GREEDY, HANG, CRASH = "too much memory", "hang", "crash"


@dataclass(slots=True)
class Tally:
    """The outcomes of a reader's inputs."""

    outcomes: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)
    growth: int = 0  # bytes by which memory grew beyond that of reading undamaged files
    slowest: float = 0.0  # s of processor time


def work(pipe: Connection, index: int, numbers: range) -> None:
    """Read a reader's inputs one by one, and send the outcome, time and memory of each."""
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
            write_files(folder, files)
            assert read_outcome(reader, folder / main) == (ACCEPTED, "")
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for number in numbers:
            main, files = damaged(reader, number)
            write_files(folder, files)
            start = time.process_time()
            result, trace = read_outcome(reader, folder / main)
            spent = time.process_time() - start
            growth = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
            if growth > GROWTH:
                pipe.send((GREEDY, f"{growth} bytes more than undamaged files", spent, growth))
                return
            pipe.send((result, trace, spent, growth))


def fuzz(index: int, name: str, count: int, step: Callable[[], object]) -> Tally:
    """Watch a worker process, and start another after each input that killed or stopped it."""
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
                result = HANG
            else:
                try:
                    result, trace, spent, growth = receiver.recv()
                    tally.slowest = max(tally.slowest, spent)
                    tally.growth = max(tally.growth, growth)
                except EOFError:
                    result = CRASH
            tally.outcomes[result] += 1
            if result not in (REFUSED, ACCEPTED):
                tally.failures.append(f"{name}, input {number}: {result}\n{trace}")
            number += 1
            patience = SECONDS
            step()
            if result in (HANG, CRASH, GREEDY):
                break
        worker.kill()
        worker.join()
    return tally


def main() -> None:
    """Read damaged files with every reader, and publish the outcomes."""
    names = [reader.name for reader in all_readers() if reader.seeds]  # this makes all seeds
    total = int(sys.argv[1]) if len(sys.argv) > 1 else INPUTS
    count = -(-total // len(names))
    rows = []
    failures: list[str] = []
    with tqdm(total=count * len(names), unit="file") as bar:
        for index, name in enumerate(names):
            bar.set_description(name)
            tally = fuzz(index, name, count, bar.update)
            failures += tally.failures
            bad = [TRACEBACK, INVALID, CRASH, HANG, GREEDY]
            outcomes = [tally.outcomes[kind] for kind in (REFUSED, ACCEPTED, *bad)]
            numbers = [f"{n}" for n in (sum(outcomes), *outcomes)]
            rows.append([name, *numbers, f"{tally.growth / 2**20:.0f}", f"{tally.slowest:.2f}"])
    for failure in failures:
        print(failure, file=sys.stderr)
    columns = ["reader", "inputs", REFUSED, ACCEPTED, "tracebacks", "invalid results"]
    columns += ["crashes", "hangs", "too much memory", "memory grew by, MiB", "slowest, s"]
    text = (
        "This page shows what each reader does with damaged files. Files that it accepts are "
        "damaged in one place or a few: bits, bytes, integers, numbers, words or lines are "
        "changed; pieces are cut out, repeated or replaced by pieces of other files; so are single "
        "members of archives and branches of YAML trees. A refused file gives an error of the "
        f"package. An input may take {GROWTH / 2**20:.0f} MiB of memory, {MEMORY / 2**30:.0f} GiB "
        f"of address space and {SECONDS:.0f} s. Memory is compared with that of reading the "
        "undamaged files."
    )
    publish(
        "fuzz", "Damaged files", [text, table(columns, rows)], machine("PyYAML", "pyuff", "rosbags")
    )
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
