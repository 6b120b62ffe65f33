# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A pool of processes on this machine that survives the death of any of them."""

import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context, parent_process
from queue import SimpleQueue
from typing import ParamSpec, TypeVar

from linkage_vibration.errors import LinkageVibrationError

P = ParamSpec("P")
T = TypeVar("T")

TRIES = 3  # how often a task is tried if its process dies


class ProcessError(LinkageVibrationError):
    """A task killed its process, or the pool has no processes."""


class LocalPool(Executor):
    """Processes on this machine, each with one BLAS thread; a process that dies is replaced.

    A `ProcessPoolExecutor` breaks as a whole when one of its processes dies, and does not say which
    task it was. Here every process is a pool of its own, so a death affects one task only. By
    default there is one for each core that this process may use.
    """

    def __init__(self, workers: int | None = None) -> None:
        if workers is None:
            workers = len(os.sched_getaffinity(0))
        if workers < 1:
            raise ProcessError(f"{workers} workers cannot do anything; ask for at least one.")
        self._threads = ThreadPoolExecutor(workers)
        self._idle: SimpleQueue[ProcessPoolExecutor | None] = SimpleQueue()
        for _ in range(workers):
            self._idle.put(None)

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Call a picklable function in one of the processes, and return the future of its result.

        The future raises `ProcessError` if the process died each time, and `BrokenExecutor` if no
        process can be started.
        """
        return self._threads.submit(self._call, fn, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes when their tasks are done; tasks that wait may be cancelled."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        while not self._idle.empty():
            pool = self._idle.get()
            if pool is not None:
                pool.shutdown(wait)

    def _call(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
        pool = self._idle.get()  # there is one for each thread
        try:
            for _ in range(TRIES):
                if pool is None:
                    pool = ProcessPoolExecutor(1, get_context("spawn"), _begin_process)
                    pool.submit(os.getpid).result()  # raises BrokenExecutor if it cannot start
                try:
                    return pool.submit(fn, *args, **kwargs).result()
                except BrokenProcessPool:
                    pool.shutdown()
                    pool = None
            raise ProcessError(
                f"The task's process died {TRIES} times; if memory ran out, use fewer workers."
            )
        finally:
            self._idle.put(pool)


def _begin_process() -> None:
    """Use one BLAS thread, ignore Ctrl-C, which the parent handles, and end with the parent."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # NumPy, which is imported later, reads it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
