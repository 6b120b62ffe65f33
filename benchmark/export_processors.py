# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares exported C on processors with the node: ``python -m benchmark export_processors``."""

import math
import shutil
import tempfile
from pathlib import Path

import numpy as np

from benchmark.report import machine, publish, table
from linkage_vibration.export.constants import NUMBERS, export_of
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.levels import kept_levels
from linkage_vibration.prediction.predictor import Predictor, predict_many
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import DEFAULT_MECHANISM, DEFAULT_TABLE, config_file
from linkage_vibration.table.table import load_table
from test.support.c_code import TARGETS, angles_to_test, run_program

LEVELS = ("velocities", "accelerations", "amplifications", "total_velocity", "total_acceleration")
LOADS = ("load_ratios", "total_load_ratio")


def processors() -> list[list[str]]:
    """Return how many numbers agree on this processor and on emulated ones."""
    mechanism = read_mechanism(config_file(DEFAULT_MECHANISM))
    hitch = load_table(config_file(DEFAULT_TABLE), mechanism)
    excitations = read_excitations(config_file("excitations.yaml"))
    orders = [excitation for excitation in excitations if excitation.terrain is None]
    export, predictor = export_of(hitch, mechanism, orders), Predictor(hitch)
    angles = angles_to_test(export.constants)
    for start, end in export.constants.gaps:
        angles = angles[~((start <= angles) & (angles < end))]
    speeds = np.random.default_rng(2).uniform(0.0, (3000.0, 1200.0, 12.0), (len(angles), 3))
    speeds[::7], speeds[::11, 1] = 0.0, math.nan
    stddevs = np.where(np.arange(len(angles)) % 2, 1e-3, 0.0)
    predicted = predict_many(predictor, angles, stddevs)
    levels = kept_levels(predictor, mechanism, orders).at(angles, speeds.T)
    columns = [predicted.status, *(getattr(predicted, name) for name in NUMBERS)]
    columns += [getattr(levels, name) for name in LEVELS + LOADS]
    node, widths = np.column_stack(columns), [np.atleast_2d(each.T).shape[0] for each in columns]
    exact, single = 1 + len(NUMBERS), len(columns) - len(LOADS)
    ends = np.cumsum(widths)[[exact - 1, single - 1]]
    rows = []
    for target, emulator in {"": "", **TARGETS}.items():
        compiler, emulators = f"{target}-gcc" if target else "gcc", [emulator] * bool(target)
        if not shutil.which(compiler) or not all(map(shutil.which, emulators)):
            rows.append([compiler, "not installed", "", "", ""])
            continue
        with tempfile.TemporaryDirectory() as folder:
            flags = "-O2", "-ffp-contract=off", "-fexcess-precision=fast", "-static"
            given = np.column_stack([angles, stddevs, speeds])
            answers = run_program(export, given, Path(folder), compiler, *flags, emulator=emulators)
        parts = zip(np.split(answers, ends, axis=1), np.split(node, ends, axis=1), strict=True)
        rows.append([compiler, *(_difference(*part) for part in parts)])
    return rows


def _difference(actual: FloatArray, expected: FloatArray) -> str:
    """Return the share of numbers that are equal, or the largest difference of two tables."""
    np.testing.assert_array_equal(np.isnan(actual), np.isnan(expected))
    if np.array_equal(actual, expected, equal_nan=True):
        return f"all {actual.size} equal"
    largest = np.fmax(1e-12, np.nanmax(np.abs(expected), axis=0))
    return f"{np.nanmax(np.abs(actual - expected) / largest):.1e}"


def main() -> None:
    """Run the program on each processor and publish how far its numbers are from the node's."""
    publish(
        "export_processors",
        "Exported C on several processors",
        [
            "An export of the hitch on a tractor with excitations is compiled with -O2 "
            "-ffp-contract=off, and runs in an emulator (qemu). The table has the largest "
            "differences from the numbers of the node, over the largest number of each column. A "
            "processor with mips or s390x stores the highest byte of a number first, and i686 "
            "computes with 80 bits. The node has levels and load ratios in single precision, and "
            "the load ratios of an export have errors of their own, of 1 %.",
            table(["compiler", "predictions", "levels", "load ratios"], processors()),
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
