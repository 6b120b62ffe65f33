# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares answers about 10,000 random drives with their messages: ``-m benchmark.random_drives``.

Each is checked as `test/review/test_verdict_from_messages.py` does it.
"""

import itertools
import math
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

from benchmark.report import machine, publish, table
from test.review.test_verdict_from_messages import check_drive, is_calm, prepare_once
from test.support.random_resonances import (
    CRANK_ANGLE,
    LONGEST,
    UNKNOWN,
    Message,
    durations_of,
    warnings_of,
)

DRIVES, PART = 10_000, 100
Steps = list[int]
KINDS: dict[str, Callable[[list[Message], Steps], bool]] = {
    "a gap of more than 3 s": lambda _, steps: any(step > LONGEST for step in steps),
    "each reading more than 3 s after the one before": lambda _, steps: (
        bool(steps) and all(step < 0 or step > LONGEST for step in steps)
    ),
    "a stamp that is earlier than the one before": lambda _, steps: min(steps, default=0) < 0,
    "a stamp that is zero": lambda drive, _: any(each.stamp == 0 for each in drive),
    "a stamp that is repeated": lambda _, steps: 0 in steps,
    "a source that is not known": lambda drive, _: any(each.unknown for each in drive),
    "a total load that is NaN": lambda drive, _: any(math.isnan(each.total) for each in drive),
    "a crank angle outside of the table": lambda drive, _: any(
        each.unknown & CRANK_ANGLE for each in drive
    ),
    "loads of two excitations or more": lambda drive, _: any(
        sum(ratio == ratio for ratio in each.ratios) > 1 for each in drive
    ),
    "a limit that changes": lambda drive, _: len({each.limit for each in drive}) > 1,
    "an excitation that is not known": lambda drive, _: any(UNKNOWN in d.states for d in drive),
    "a load above its limit": lambda drive, _: durations_of(drive)[0] > 0.0,
    "a warning": lambda drive, _: bool(warnings_of(drive)),
    "less than 95 % known": lambda drive, _: (
        durations_of(drive)[2] > 0.05 * sum(durations_of(drive))
    ),
    "calm: nothing above its limit, 95 % known": lambda drive, _: is_calm(drive),
}


def checked(first: int) -> tuple[Counter[str], list[str], float]:
    """Return how many drives have what, what failed, and the processor time, s."""
    counts, failures = Counter[str](), list[str]()
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory() as folder:
        prepare_once(patch)
        begin = time.process_time()
        for seed in range(first, first + PART):
            try:
                drive = check_drive(Path(folder), seed)
            except Exception as error:  # A crash is a fault, too.
                failures.append(f"{seed}: {error!r}"[:300])
                continue
            steps = [b.stamp - a.stamp for a, b in itertools.pairwise(drive)]
            counts["messages"] += len(drive)
            counts.update(name for name, has in KINDS.items() if has(drive, steps))
        return counts, failures, time.process_time() - begin


def main() -> None:
    """Check all drives on all processors, and publish what they had and which failed."""
    counts, failures, spent = Counter[str](), list[str](), 0.0
    with ProcessPoolExecutor() as pool:
        for each, failed, seconds in pool.map(checked, range(PART, PART + DRIVES, PART)):
            counts += each
            failures += failed
            print("\n".join(failed), end="", flush=True)
            spent += seconds
    publish(
        "random_drives",
        "What is said about random drives",
        [
            f"This page compares what is said about {DRIVES:,} random drives with an oracle, which "
            "reads their messages only and shares no code with the package: the seconds above the "
            "limit, below it, and not known; the warnings; what each excitation did; the worst "
            "moment; how the first sentence begins; the colour of the overview; the exit code of "
            "`--strict`; and whether `check_bag` passes. A fault is an answer that is better than "
            "the oracle's, or another number.",
            f"- {len(failures)} of {DRIVES:,} drives have a fault.\n"
            f"- A drive takes {spent / DRIVES:.3f} s of processor time, and has "
            f"{counts['messages'] / DRIVES:.0f} messages.",
            table(["what a drive has", "drives"], [[k, f"{counts[k]:,}"] for k in KINDS]),
            *(["Faults:", "\n".join(f"- {each}" for each in failures)] if failures else []),
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
