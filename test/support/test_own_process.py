# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Calls in a process of their own: a death is survived or reported, and nothing stays behind."""

import multiprocessing
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from linkage_vibration.support.own_process import ProcessError, call_in_process


def test_task_that_kills() -> None:
    """A function whose process dies is given up, and no process remains."""
    assert call_in_process(os.getpid) != os.getpid()
    before = multiprocessing.active_children()
    with pytest.raises(ProcessError, match="died; check the free memory"):
        call_in_process(signal.raise_signal, signal.SIGKILL)
    with pytest.raises(ZeroDivisionError):
        call_in_process(divmod, 1, 0)
    assert multiprocessing.active_children() == before


def test_process_has_one_blas_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """It sees the setting whatever the caller has, which stays as it was."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    assert call_in_process(os.getenv, "OPENBLAS_NUM_THREADS") == "1"
    assert os.environ["OPENBLAS_NUM_THREADS"] == "7"


def test_main_module_that_imports_numpy(tmp_path: Path) -> None:
    """The process has the setting before its main module, which may import NumPy, is imported."""
    script = tmp_path / "main.py"
    script.write_text("""
import os

from linkage_vibration.support.own_process import call_in_process

SEEN = os.getenv("OPENBLAS_NUM_THREADS")  # when NumPy would read it


def seen():
    return SEEN


if __name__ == "__main__":
    print(SEEN, call_in_process(seen), os.getenv("OPENBLAS_NUM_THREADS"))
""")
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, script],
        env=environment | {"PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
    )
    assert done.stdout == "None 1 None\n", done.stderr


def test_processes_that_cannot_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no process comes up, the call says so instead of trying for ever."""
    monkeypatch.setattr(multiprocessing.spawn, "_python_exe", b"/bin/false")
    with pytest.raises(ProcessError):
        call_in_process(os.getpid)
