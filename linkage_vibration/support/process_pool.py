# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A pool of processes on this machine that outlives the death of any of them."""

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

TRIES = 3  # of a task whose process dies


class ProcessError(LinkageVibrationError):
    """A task killed its process, or there is none to run it."""


class LocalPool(Executor):
    """Processes on this machine, each with one BLAS thread; one that dies is begun anew.

    A `ProcessPoolExecutor` breaks as a whole when one of its processes dies, and does not tell at
    which task. Here every process is a pool of its own: a death costs one task one try, and leaves
    the others alone.

    Parameters
    ----------
    workers : int, optional
        How many processes; one for each core that this process may use unless given.
    """

    def __init__(self, workers: int | None = None) -> None:
        if workers is None:
            workers = len(os.sched_getaffinity(0))
        if workers < 1:
            raise ProcessError(f"{workers} workers do nothing; ask for at least one.")
        self._threads = ThreadPoolExecutor(workers)
        self._idle: SimpleQueue[ProcessPoolExecutor | None] = SimpleQueue()
        for _ in range(workers):
            self._idle.put(None)
        self._starting = threading.Lock()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Call a function in one of the processes.

        The future raises `ProcessError` if the process died each time, `BrokenExecutor` if none can
        be started.
        """
        return self._threads.submit(self._call, fn, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes once their tasks are done."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        while not self._idle.empty():
            pool = self._idle.get()
            if pool is not None:
                pool.shutdown(wait)

    def _call(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
        pool = self._idle.get()  # there are as many as there are threads
        try:
            for _ in range(TRIES):
                pool = pool or self._start()
                try:
                    return pool.submit(fn, *args, **kwargs).result()
                except BrokenProcessPool:
                    pool.shutdown()
                    pool = None
            raise ProcessError(
                f"Its process died {TRIES} times; if memory ran out, use fewer workers."
            )
        finally:
            self._idle.put(pool)

    def _start(self) -> ProcessPoolExecutor:
        pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin_process)
        with self._starting, _one_blas_thread():
            first = pool.submit(os.getpid)  # starts the process, which takes the environment over
        first.result()
        return pool


def _begin_process() -> None:
    """Leave Ctrl-C to the parent, and end with it however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _one_blas_thread() -> Iterator[None]:
    """Set the environment for processes that begin meanwhile."""
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
