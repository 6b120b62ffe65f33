# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The local pool: deaths cost one task one try each, and nothing stays behind."""

import multiprocessing
import os
import signal
from concurrent.futures import BrokenExecutor

import pytest

from linkage_vibration.support.process_pool import LocalPool, ProcessError


def test_task_that_kills_is_given_up() -> None:
    """The pool starts its process again each time, and completes the other tasks."""
    before = multiprocessing.active_children()
    with LocalPool(1) as pool:
        tasks = [
            pool.submit(signal.raise_signal, signal.SIGKILL),
            pool.submit(divmod, 7, 2),
            pool.submit(divmod, 1, 0),
        ]
        with pytest.raises(ProcessError, match="died 3 times"):
            tasks[0].result()  # type: ignore[attr-defined]
        assert tasks[1].result() == (3, 1)  # type: ignore[attr-defined]
        with pytest.raises(ZeroDivisionError):
            tasks[2].result()  # type: ignore[attr-defined]
    assert multiprocessing.active_children() == before


def test_killed_process_is_replaced() -> None:
    """A process that somebody kills between two tasks is missed by none."""
    with LocalPool(1) as pool:
        first = pool.submit(os.getpid).result()
        os.kill(first, signal.SIGKILL)
        assert pool.submit(os.getpid).result() not in (first, os.getpid())


def test_processes_have_one_blas_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """They see the setting whatever the caller has, which stays as it was."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    with LocalPool(1) as pool:
        assert pool.submit(os.getenv, "OPENBLAS_NUM_THREADS").result() == "1"
    assert os.environ["OPENBLAS_NUM_THREADS"] == "7"


def test_processes_that_cannot_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no process comes up, each task says so instead of trying for ever."""
    monkeypatch.setattr(multiprocessing.spawn, "_python_exe", b"/bin/false")
    with LocalPool(1) as pool, pytest.raises(BrokenExecutor):
        pool.submit(os.getpid).result()


def test_pool_of_none() -> None:
    """A pool without a process is refused."""
    with pytest.raises(ProcessError, match="at least one"):
        LocalPool(0)
