# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A pool of processes on this machine that survives the death of any of them."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
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
        self._starting = threading.Lock()

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
                pool = pool or self._start()
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

    def _start(self) -> ProcessPoolExecutor:
        pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin_process)
        with self._starting, _one_blas_thread():
            first = pool.submit(os.getpid)  # starts the process, which copies the environment
        first.result()
        return pool


def _begin_process() -> None:
    """Ignore Ctrl-C, which the parent handles, and end when the parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread in processes that start within this context."""
    name = "OPENBLAS_NUM_THREADS"
    before = os.environ.get(name)
    os.environ[name] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before
