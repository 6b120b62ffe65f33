# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Programs that some tests need, and which of them would enable more tests."""

import re
import shutil
from collections import Counter
from collections.abc import Iterable

import pytest

# The packages of Debian and Ubuntu that have them.
PACKAGES = {
    "aarch64-linux-gnu-gcc": "gcc-aarch64-linux-gnu",
    "arm-linux-gnueabihf-gcc": "gcc-arm-linux-gnueabihf",
    "arm-none-eabi-gcc": "gcc-arm-none-eabi",
    "cc": "gcc",
    "chromium": "chromium",
    "clang": "clang",
    "cmake": "cmake",
    "cppcheck": "cppcheck",
    "dpkg": "dpkg",
    "gcc": "gcc",
    "i686-linux-gnu-gcc": "gcc-i686-linux-gnu",
    "nm": "binutils",
    "mips-linux-gnu-gcc": "gcc-mips-linux-gnu",
    "qemu-aarch64": "qemu-user",
    "qemu-arm": "qemu-user",
    "qemu-i386": "qemu-user",
    "qemu-mips": "qemu-user",
    "qemu-riscv64": "qemu-user",
    "qemu-s390x": "qemu-user",
    "riscv64-linux-gnu-gcc": "gcc-riscv64-linux-gnu",
    "s390x-linux-gnu-gcc": "gcc-s390x-linux-gnu",
    "sqlite3": "sqlite3",
}


def require(program: str, *others: str) -> str:
    """Return the path of a program, or of another that does the same; skip the test without one."""
    actual = next(filter(None, map(shutil.which, (program, *others))), None)
    if actual is None:
        pytest.skip(f"{program} is not installed; run apt-get install {PACKAGES[program]}")
    return actual


def missing_programs(reasons: Iterable[str]) -> str:
    """Return one line about the programs that the reasons of skipped tests name; or nothing."""
    named = (re.search(r"(\S+) is not installed; run apt-get install", each) for each in reasons)
    counts = Counter(each[1] for each in named if each)
    if not counts:
        return ""
    tests = ", ".join(f"{count} with {program}" for program, count in sorted(counts.items()))
    packages = " ".join(sorted({PACKAGES[program] for program in counts}))
    return f"More tests would run: {tests}; run `apt-get install {packages}`."
