# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compiles exported C, and calls it at many angles."""

import ctypes
import math
import re
import subprocess
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.export.c_source import c_sources
from linkage_vibration.export.constants import FARTHEST, NUMBERS, PER_MODE, Constants, Export
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.severity import WarningLimits
from test.support.programs import require

COMPILERS = ("gcc", "clang")
EXACT = ("-O2", "-ffp-contract=off")
STRICT = (
    *("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion"),
    *("-Wshadow", "-Wcast-qual", "-Wstrict-prototypes", "-Wmissing-prototypes", "-Werror"),
)
SANITIZERS = ("-g", "-ffp-contract=off", "-fsanitize=address,undefined", "-fno-sanitize-recover")
TARGETS = {
    "aarch64-linux-gnu": "qemu-aarch64",
    "arm-linux-gnueabihf": "qemu-arm",
    "i686-linux-gnu": "qemu-i386",
    "mips-linux-gnu": "qemu-mips",
    "riscv64-linux-gnu": "qemu-riscv64",
    "s390x-linux-gnu": "qemu-s390x",
}
"""Processors, and what emulates them."""

_LOOP = """
#include "PREFIX.h"
#include <stddef.h>
void predict_many(const double *angles, const double *stddevs, size_t count,
                  PREFIX_prediction *found);
void predict_many(const double *angles, const double *stddevs, size_t count,
                  PREFIX_prediction *found)
{
    size_t i;
    for (i = 0u; i < count; i++) {
        PREFIX_predict(angles[i], stddevs[i], &found[i]);
    }
}
"""
_ASSESS = """
void assess_many(const PREFIX_prediction *predictions, const double *speeds, size_t count,
                 PREFIX_resonance *found);
void assess_many(const PREFIX_prediction *predictions, const double *speeds, size_t count,
                 PREFIX_resonance *found)
{
    size_t i;
    for (i = 0u; i < count; i++) {
        PREFIX_assess(&predictions[i], &speeds[PREFIX_SPEEDS * i], &found[i]);
    }
}
void judge_many(const PREFIX_prediction *predictions, const PREFIX_resonance *resonances,
                const int64_t *times, const PREFIX_limits *limits, size_t count,
                PREFIX_load_state *found);
void judge_many(const PREFIX_prediction *predictions, const PREFIX_resonance *resonances,
                const int64_t *times, const PREFIX_limits *limits, size_t count,
                PREFIX_load_state *found)
{
    PREFIX_warnings warnings = {0};
    size_t i;
    for (i = 0u; i < count; i++) {
        PREFIX_judge(&predictions[i], &resonances[i], limits, times[i], &warnings, &found[i]);
    }
}
"""

_PROGRAM = """
#include "PREFIX.h"
#include <stddef.h>
#include <stdio.h>
static void show(const void *from, const void *to)
{
    const double *number = from;
    for (; number != to; number++) {
        printf(" %a", *number);
    }
}
int main(void)
{
    double at[5];
    while (scanf("%la %la %la %la %la", &at[0], &at[1], &at[2], &at[3], &at[4]) == 5) {
        PREFIX_prediction predicted;
        PREFIX_predict(at[0], at[1], &predicted);
        printf("%d", (int)predicted.status);
        show(predicted.natural_frequencies, &predicted + 1);
        ASSESSED
        printf("\\n");
    }
    return 0;
}
"""
_ASSESSED = """{
            PREFIX_resonance found;
            PREFIX_assess(&predicted, &at[2], &found);
            show(found.velocities, &found + 1);
        }"""


def compile_c(command: Sequence[Any], folder: Path) -> None:
    """Compile in a folder; fail with what the compiler prints."""
    done = subprocess.run([*map(str, command)], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr == "", done.stderr


def write(files: Mapping[str, str], folder: Path) -> None:
    """Write files into a folder."""
    for name, text in files.items():
        (folder / name).write_text(text)


def misra_rules(files: Mapping[str, str], folder: Path) -> set[str]:
    """Return the rules of MISRA C:2012 that cppcheck finds broken; it finds no error.

    It reads the files without the numbers of their tables, which takes seconds.
    """
    tables = re.compile(r"(?<=\]) = \{\n[^;]*\};")
    write({name: tables.sub(";", text) for name, text in files.items()}, folder)
    [source] = [name for name in files if name.endswith(".c")]
    command = [require("cppcheck"), "--addon=misra", "--enable=style", "--std=c99", "--quiet"]
    command += ["-U__FAST_MATH__", "-U__FINITE_MATH_ONLY__", "-DDBL_MANT_DIG=53", source]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert ": error:" not in done.stderr, done.stderr
    return set(re.findall(r"misra-c2012-([0-9.]+)", done.stderr))


_sources_of = cache(c_sources)  # An export is written once for all processors.


def run_program(
    export: Export,
    rows: FloatArray,
    folder: Path,
    compiler: str,
    *flags: str,
    emulator: Sequence[str] = (),
) -> FloatArray:
    """Return what exported C, compiled with strict warnings to a program, answers to each row.

    A row is an angle, its deviation and the speeds; the answer is the status, the `NUMBERS`, and
    with excitations all from the velocities on.
    """
    write(_sources_of(export), folder)
    orders, prefix = export.constants.orders is not None, export.name
    text = _PROGRAM.replace("ASSESSED", _ASSESSED if orders else "")
    (folder / "main.c").write_text(text.replace("PREFIX", prefix))
    compile_c([compiler, *STRICT, *flags, f"{prefix}.c", "main.c", "-lm", "-o", "run"], folder)
    given = "\n".join(" ".join(map(float.hex, row)) for row in rows.tolist())
    command = [*emulator, folder / "run"]
    done = subprocess.run(command, capture_output=True, text=True, input=given, check=True)
    assert not done.stderr, done.stderr
    return np.array([list(map(float.fromhex, line.split())) for line in done.stdout.splitlines()])


def angles_to_test(constants: Constants, count: int = 1000) -> FloatArray:
    """Return angles in and around the range, with its ends, borders of cells, NaN and infinity.

    There are at least 20.
    """
    low, high = constants.alpha3_range
    special = [math.nan, math.inf, -math.inf, 0.0, -low, high + 2.0 * math.pi]
    special += [low - 20.0 * math.pi, 1e5, 1e30]
    special += [0.7 * low + 0.3 * high + turns * 2.0 * math.pi for turns in (-2, -1, 1, 2)]
    cells = constants.starts[:: max(1, 4 * len(constants.starts) // count)]
    at = np.array([low, high, *cells.tolist()])
    ends = np.nextafter(at, -math.inf), at, [np.nextafter(high, math.inf)]
    chosen = np.concatenate([special, *ends])[:count]
    random = np.random.default_rng(2)
    rest = count - len(chosen)
    inside = random.uniform(low, high, rest)
    far = random.uniform(-FARTHEST, FARTHEST, rest)
    return np.concatenate([chosen, np.where(np.arange(rest) % 10 == 0, far, inside)])


class Library:
    """Exported C, compiled as a shared library."""

    def __init__(
        self, folder: Path, export: Export, compiler: str = "gcc", flags: Sequence[str] = EXACT
    ) -> None:
        prefix, self._orders = export.name, export.constants.orders
        write(c_sources(export), folder)
        loop = _LOOP + (_ASSESS if self._orders else "")
        (folder / "loop.c").write_text(
            loop.replace("PREFIX_SPEEDS", f"{prefix.upper()}_SPEEDS").replace("PREFIX", prefix)
        )
        sources = f"{prefix}.c", "loop.c"
        command = [require(compiler), *STRICT, *flags, "-fPIC", "-shared", "-o", "library.so"]
        compile_c([*command, *sources, "-lm"], folder)
        self._library = ctypes.CDLL(str(folder / "library.so"))
        modes, first = export.constants.n_modes, NUMBERS[len(PER_MODE) :]
        self._prediction = np.dtype(
            [
                ("crank_angle", float),
                ("status", np.int32),
                *((name, float, (modes,)) for name in PER_MODE),
                *((name, float) for name in first),
            ],
            align=True,
        )

    def predict(self, angles: FloatArray, stddevs: FloatArray) -> NDArray[np.void]:
        """Return the predictions at angles, as a structured array."""
        values = np.zeros(len(angles), self._prediction)
        own = [np.ascontiguousarray(x, float) for x in (angles, stddevs)]
        pointers = [ctypes.c_void_p(x.ctypes.data) for x in (*own, values)]
        self._library.predict_many(*pointers[:2], ctypes.c_size_t(len(values)), pointers[2])
        return values

    def assess(self, predictions: NDArray[np.void], speeds: FloatArray) -> NDArray[np.void]:
        """Return what excitations do, with speeds of shape (n, 3)."""
        assert self._orders is not None
        n = len(self._orders.excitations)
        kind = np.dtype(
            [
                ("excitation_frequency", float, (n,)),
                ("nearest_mode", np.int32, (n,)),
                *(
                    (name, float, (n,))
                    for name in (
                        "margin",
                        "relative_margin",
                        "velocities",
                        "accelerations",
                        "amplifications",
                    )
                ),
                ("total_velocity", float),
                ("total_acceleration", float),
                ("load_ratios", float, (n,)),
                ("total_load_ratio", float),
            ],
            align=True,
        )
        values = np.zeros(len(predictions), kind)
        own = np.ascontiguousarray(speeds, float)
        pointers = [ctypes.c_void_p(x.ctypes.data) for x in (predictions, own, values)]
        self._library.assess_many(*pointers[:2], ctypes.c_size_t(len(values)), pointers[2])
        return values

    def judge(
        self,
        predictions: NDArray[np.void],
        resonances: NDArray[np.void],
        times: NDArray[np.int64],
        limits: WarningLimits,
    ) -> NDArray[np.int32]:
        """Return states at times, ns, (n, 2 + n_orders): of all, the worst one, and of each."""
        assert self._orders is not None
        values = np.zeros((len(times), 2 + len(self._orders.excitations)), np.int32)
        kind = [("warning", float), ("note", float), ("near", float), ("dwell", np.int64)]
        own = limits.warning, limits.note, limits.near, round(1e9 * limits.dwell)
        given = np.array(own, np.dtype(kind, align=True))
        every = (predictions, resonances, np.ascontiguousarray(times, np.int64), given, values)
        pointers = [ctypes.c_void_p(x.ctypes.data) for x in every]
        self._library.judge_many(*pointers[:4], ctypes.c_size_t(len(values)), pointers[4])
        return values
