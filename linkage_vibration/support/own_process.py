# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Calls a function in a process of its own, which may die without harm."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from typing import ParamSpec, TypeVar

from linkage_vibration.errors import LinkageVibrationError

P = ParamSpec("P")
T = TypeVar("T")


class ProcessError(LinkageVibrationError):
    """The process of a call died."""


def call_in_process(function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Call a picklable function in a new process with one BLAS thread; see `ProcessError`."""
    with ProcessPoolExecutor(1, get_context("spawn"), _begin_process) as pool:
        try:
            with _one_blas_thread():  # the process starts here
                answer = pool.submit(function, *args, **kwargs)
            return answer.result()
        except BrokenProcessPool:
            raise ProcessError("The process of a task died; check the free memory.") from None


@contextmanager
def _one_blas_thread() -> Iterator[None]:
    """Let new processes have one BLAS thread, as several would mostly wait for each other."""
    name = "OPENBLAS_NUM_THREADS"
    before, os.environ[name] = os.environ.get(name), "1"
    try:
        yield
    finally:
        os.environ.pop(name)
        if before is not None:
            os.environ[name] = before


def _begin_process() -> None:
    """Ignore Ctrl-C, which the parent handles, and end with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
