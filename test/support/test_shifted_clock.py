# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The shifted clock behaves as a wall clock that somebody sets."""

import subprocess
import sys
from pathlib import Path

import pytest

from test.support.shifted_clock import shifted_clock

# Waits 0.4 s by the wall clock, as glibc's functions do, and prints when each wait was over.
WAIT = """
import ctypes, struct, sys, time
libc, file, ahead = ctypes.CDLL(None, use_errno=True), open(sys.argv[1], "r+b"), float(sys.argv[2])
class Time(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]
space = [ctypes.create_string_buffer(64) for _ in range(3)]
semaphore, condition, mutex = map(ctypes.byref, space)
libc.sem_init(semaphore, 0, 0)
libc.pthread_mutex_lock(mutex)
for wait in ((libc.sem_timedwait, semaphore), (libc.pthread_cond_timedwait, condition, mutex),
             (libc.pthread_mutex_timedlock, mutex)):
    file.seek(0); file.write(bytes(8)); file.flush()
    began, end = time.monotonic(), time.time() + 0.4
    def set_clock():
        file.seek(0); file.write(struct.pack("q", int(ahead * 1e9))); file.flush()
    import threading
    threading.Timer(0.1, set_clock).start()
    wait[0](*wait[1:], ctypes.byref(Time(int(end), int(end % 1 * 1e9))))
    print(time.monotonic() - began, time.time() - end)
"""


@pytest.mark.parametrize(("ahead", "lasts"), [(-0.5, 0.9), (3600.0, 0.1)])
def test_waits_end_by_the_shifted_clock(tmp_path: Path, ahead: float, lasts: float) -> None:
    """A wait for 0.4 s lasts longer if the clock is set back, and ends if it is set forward."""
    clock = shifted_clock(tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", WAIT, clock.file, str(ahead)],
        env=clock.environment,
        capture_output=True,
        text=True,
        check=True,
    )
    waits = [[float(word) for word in line.split()] for line in done.stdout.splitlines()]
    assert len(waits) == 3
    for seconds, after in waits:
        assert lasts <= seconds + 0.01 < lasts + 0.3
        assert after >= 0.0
