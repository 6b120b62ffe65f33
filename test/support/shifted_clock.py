# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A wall clock that a test sets while another process runs; all other clocks run on."""

import struct
import subprocess
from dataclasses import dataclass
from pathlib import Path

from test.support.programs import require


@dataclass(frozen=True)
class ShiftedClock:
    """The wall clock of processes with this environment; the file says how far it is ahead, ns."""

    environment: dict[str, str]
    file: Path

    def set(self, ahead: float) -> None:
        """Set the clock ahead of the real one by some seconds, or behind it."""
        with self.file.open("r+b") as file:
            file.write(struct.pack("q", round(ahead * 1e9)))


def shifted_clock(folder: Path) -> ShiftedClock:
    """Return a clock that is right so far; its library and its file are in a folder."""
    library, file = folder / "shifted_clock.so", folder / "ahead"
    source = Path(__file__).with_suffix(".c")
    command = [require("gcc"), "-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
    subprocess.run([*command, source, "-o", library, "-pthread", "-ldl"], check=True)
    file.write_bytes(bytes(8))
    return ShiftedClock({"LD_PRELOAD": str(library), "SHIFTED_CLOCK": str(file)}, file)
