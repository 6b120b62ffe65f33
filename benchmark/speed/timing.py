# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Times methods in turns, and reports medians with quartiles.

Times are processor times, not wall-clock times. With one thread both are equal on an idle machine,
and on a busy machine other processes have less influence.
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
        """Return the same spread in another unit."""
        return Spread(self.median / unit, self.low / unit, self.high / unit)


def spread(samples: ArrayLike) -> Spread:
    """Return the median and the quartiles of samples."""
    low, median, high = np.percentile(np.asarray(samples, dtype=float), [25.0, 50.0, 75.0])
    return Spread(float(median), float(low), float(high))


def pin_threads(module: str) -> None:
    """Restart a module with one BLAS thread if it has more; NumPy reads the setting at import."""
    if os.environ.get("OPENBLAS_NUM_THREADS") != "1":
        threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-m", module, *sys.argv[1:]]
        os.execve(sys.executable, command, {**os.environ, **threads})


def clock() -> float:
    """Return the processor time of this process and its finished children, s."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


@contextmanager
def quiet() -> Iterator[None]:
    """Switch the garbage collector off while something is timed."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def seconds(job: Callable[[], object], at_least: float = 0.0) -> float:
    """Time a job; repeat it until the total is long enough for the clock.

    Parameters
    ----------
    job : callable
        The job.
    at_least : float
        Least total time, s.
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
    """Time jobs in turn in several rounds, after a warm-up.

    Parameters
    ----------
    jobs : mapping of str to callable
        The jobs by name.
    rounds : int
        Number of rounds.
    at_least : float
        Least time of one sample, s; the job is repeated for it.
    slow : float
        A job that takes longer than this (s) is run only in the first round, without a warm-up.
    step : callable
        Called after each sample, for a progress bar.

    Returns
    -------
    dict of str to list of float
        Times of the samples, s.
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
