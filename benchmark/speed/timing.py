# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Times as medians with quartiles, methods taking turns so that all see the same machine.

Times are of the processor, not of the wall: with one thread the two are the same on an idle
machine, and on a busy one what others run counts for less.
"""

import gc
import os
import resource
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True, slots=True)
class Spread:
    """A median and its quartiles."""

    median: float
    low: float
    high: float

    def __str__(self) -> str:
        """Return the median and the quartiles, three digits each."""
        return f"{self.median:.3g} ({self.low:.3g} to {self.high:.3g})"

    def over(self, unit: float) -> "Spread":
        """Return it in another unit."""
        return Spread(self.median / unit, self.low / unit, self.high / unit)


def spread(samples: ArrayLike) -> Spread:
    """Return the median and the quartiles of samples."""
    low, median, high = np.percentile(samples, [25.0, 50.0, 75.0])
    return Spread(float(median), float(low), float(high))


def pin_threads(module: str) -> None:
    """Run a module anew with one BLAS thread, unless it has one; NumPy reads that when it loads."""
    if os.environ.get("OPENBLAS_NUM_THREADS") != "1":
        threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-m", module, *sys.argv[1:]]
        os.execve(sys.executable, command, {**os.environ, **threads})


def clock() -> float:
    """Return the processor's time of this process and of those that it has run, s."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


@contextmanager
def quiet() -> Iterator[None]:
    """Keep the garbage collector out of what is timed."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def seconds(job: Callable[[], object], at_least: float = 0.0) -> float:
    """Time a job, repeated until that takes long enough for the clock.

    Parameters
    ----------
    job : callable
        What to time.
    at_least : float
        s.
    """
    repeats = 1
    while True:
        started = clock()
        for _ in range(repeats):
            job()
        taken = clock() - started
        if taken >= at_least:
            return taken / repeats
        repeats = max(2 * repeats, int(1.2 * repeats * at_least / max(taken, 1e-9)))


def turns(
    jobs: Mapping[str, Callable[[], object]],
    rounds: int,
    *,
    at_least: float = 0.0,
    slow: float = float("inf"),
    step: Callable[[], object] = lambda: None,
) -> dict[str, list[float]]:
    """Time jobs in turn, round after round, after a warm-up.

    Parameters
    ----------
    jobs : mapping of str to callable
        What to time.
    rounds : int
        How often each.
    at_least : float
        s, that one sample takes, by repetition.
    slow : float
        s; a job that takes longer than this is run in the first round alone, without a warm-up.
    step : callable
        Called after each sample, for a progress bar.

    Returns
    -------
    dict of str to list of float
        s, sample by sample.
    """
    samples: dict[str, list[float]] = {}
    with quiet():
        for name, job in jobs.items():
            first = seconds(job)
            samples[name] = [first] if first > slow else [seconds(job, at_least)]
            step()
    for _ in range(rounds - 1):
        with quiet():
            for name, job in jobs.items():
                if samples[name][0] <= slow:
                    samples[name].append(seconds(job, at_least))
                step()
    return samples
