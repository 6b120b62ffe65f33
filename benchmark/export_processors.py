# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Runs the generated test of an export on processors: ``python -m benchmark export_processors``."""

import re
import shutil
import tempfile
from pathlib import Path

from benchmark.report import machine, publish, table
from linkage_vibration.export.exported import Export, export_of
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import DEFAULT_MECHANISM, DEFAULT_TABLE, config_file
from linkage_vibration.table.table import load_table
from test.support.c_code import TARGETS, run_test


def processors(export: Export) -> list[list[str]]:
    """Run the generated test on this processor and on emulated ones."""
    rows = []
    for target, emulator in {"": "", **TARGETS}.items():
        compiler, emulators = f"{target}-gcc" if target else "gcc", [emulator] * bool(target)
        if not shutil.which(compiler) or not all(map(shutil.which, emulators)):
            rows.append([compiler, "not installed", "", "", ""])
            continue
        with tempfile.TemporaryDirectory() as folder:
            flags = "-O2", "-ffp-contract=off", "-fexcess-precision=fast", "-static"
            done = run_test(export, Path(folder), compiler, *flags, emulator=emulators)
        pattern = r"(\d+) of (\d+) numbers .* difference is (\S+) of .*; (\d+) wrong"
        numbers = re.match(pattern, done.stdout)
        assert numbers, done.stderr
        rows.append([compiler, *numbers.groups()])
    return rows


def tested_export() -> Export:
    """Return the export whose generated test runs on each processor."""
    mechanism = read_mechanism(config_file(DEFAULT_MECHANISM))
    hitch = load_table(config_file(DEFAULT_TABLE), mechanism)
    excitations = read_excitations(config_file("excitations.yaml"))
    orders = [excitation for excitation in excitations if excitation.terrain is None]
    return export_of(hitch, mechanism, orders)


def main() -> None:
    """Run the tests and publish how many numbers agree."""
    publish(
        "export_processors",
        "Exported C on several processors",
        [
            "The generated test of an export of the hitch on a tractor with excitations finds no "
            "wrong number on any processor.",
            "It is compiled with -O2 -ffp-contract=off, and runs in an emulator (qemu). The table "
            "says how many numbers equal those of the node, the largest difference over what is "
            "allowed, and how many differ by more. A processor with mips or s390x stores the "
            "highest byte of a number first, and i686 computes with 80 bits. On the others, "
            "numbers that are not equal are levels, of which the node's are in single precision, "
            "and the load ratios, which have errors of their own.",
            table(
                ["compiler", "equal", "of", "largest share", "wrong"], processors(tested_export())
            ),
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
