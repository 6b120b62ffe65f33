# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures exported C and FMUs: bits, sizes and times: ``python -m benchmark export_c``.

It also simulates the shipped drive with FMPy, and draws docs/pictures/export.png.
"""

import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmark.report import machine, publish, table
from linkage_vibration.cli.main import main as command
from linkage_vibration.drawing.palette import INK, mode_colours
from linkage_vibration.export.constants import NUMBERS, Export, export_of
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.predictor import Predictor, predict_many
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.review.log import Log, read_log
from linkage_vibration.support.resources import DEFAULT_TABLE, PAPER_TABLE, config_file
from linkage_vibration.table.table import Table, load_table
from linkage_vibration.table.tabulation import build_table
from test.support.c_code import EXACT, Library, angles_to_test
from test.support.fmu import differences, simulate

FloatArray = NDArray[np.float64]

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "export.png"
ANGLES = 100_000
FMA = ("-O2", "-march=native", "-ffp-contract=fast")
ROUNDS = 7
STEPS = 0.01, 0.05  # s, of co-simulations
BIT_COLUMNS = ["table", "compiler and options", "equal numbers", "of", "largest difference"]
SIZE_COLUMNS = ["table", "cells", "kB", "text and data, kB", "ns a call, slow", "ns a call, random"]


def tables() -> dict[str, Table]:
    """Return the shipped tables, and that of a crank that turns all the way."""
    return {
        "hitch on a tractor": load_table(config_file(DEFAULT_TABLE)),
        "hitch of the paper": load_table(config_file(PAPER_TABLE)),
        "four-bar": build_table(LinkageModel(read_mechanism(config_file("four_bar.yaml"))), 1e-4),
    }


def library(export: Export, compiler: str, flags: tuple[str, ...]) -> tuple[Library, float]:
    """Compile an export; return the loaded library and the compiled size, kB."""
    with tempfile.TemporaryDirectory() as name:
        made = Library(Path(name), export, compiler, flags)
        return made, text_and_data(Path(name), export.name)


def text_and_data(folder: Path, prefix: str) -> float:
    """Return the size of the compiled source without symbols, kB."""
    subprocess.run(["gcc", "-Os", "-c", f"{prefix}.c"], cwd=folder, check=True)
    done = subprocess.run(
        ["size", f"{prefix}.o"], cwd=folder, check=True, capture_output=True, text=True
    )
    text, data, *_ = done.stdout.splitlines()[1].split()
    return (int(text) + int(data)) / 1e3


def bits(name: str, of: Table) -> list[list[str]]:
    """Compare the numbers of C with those of the node, by several compilers and options."""
    export = export_of(of)
    angles = angles_to_test(export.constants, ANGLES)
    stddevs = np.where(np.arange(ANGLES) % 2, 1e-3, 0.0)
    expected = predict_many(Predictor(of), angles, stddevs)
    rows = []
    for compiler, flags in (("gcc", EXACT), ("clang", EXACT), ("gcc", FMA), ("clang", FMA)):
        prediction = library(export, compiler, flags)[0].predict(angles, stddevs)
        assert (prediction["status"] == expected.status).all()
        equal = total = 0
        worst = 0.0
        for field in NUMBERS:
            first, other = prediction[field], getattr(expected, field)
            same = (first == other) | (np.isnan(first) & np.isnan(other))
            equal, total = equal + int(same.sum()), total + same.size
            with np.errstate(all="ignore"):
                off = np.abs(first - other) / np.nanmax(np.abs(other))
            worst = max(worst, float(np.nanmax(off)))
        rows.append(
            [name, f"{compiler} {' '.join(flags)}", f"{equal:,}", f"{total:,}", f"{worst:.1e}"]
        )
    return rows


def nanoseconds(made: Library, angles: FloatArray) -> float:
    """Return the time of a call, ns: the median of several rounds."""
    stddevs, times = np.full(len(angles), 1e-3), []
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        made.predict(angles, stddevs)
        times.append(time.perf_counter() - begin)
    return 1e9 * float(np.median(times)) / len(angles)


def sizes(name: str, of: Table) -> list[str]:
    """Return the cells, sizes and times of an export."""
    export = export_of(of)
    made, kilobytes = library(export, "gcc", EXACT)
    random = np.random.default_rng(1).uniform(*of.alpha3_range, ANGLES)
    return [
        name,
        f"{len(export.constants.starts)}",
        f"{export.constants.size / 1e3:.1f}",
        f"{kilobytes:.1f}",
        f"{nanoseconds(made, np.linspace(*of.alpha3_range, ANGLES)):.0f}",
        f"{nanoseconds(made, random):.0f}",
    ]


def drive_log(folder: Path) -> Log:
    """Return the node's predictions for the shipped drive."""
    log = folder / "log.mcap"
    replay(config_file("drives/hitch_duty_cycle.mcap"), log)
    return read_log(log)


def fmus(folder: Path, log: Log) -> list[list[str]]:
    """Simulate the drive with each interface; return sizes and differences."""
    rows, path = [], folder / "hitch.fmu"
    command(["export", "--fmu", str(path)])
    size = path.stat().st_size / 1e3
    for interface, step in (("ModelExchange", STEPS[0]), *(("CoSimulation", s) for s in STEPS)):
        now, before = differences(simulate(path, interface, log, step), log, step)
        lag = "" if interface == "ModelExchange" else f"{before:.1e}"
        rows.append([interface, f"{step:g}", f"{size:.0f}", f"{now:.1e}", lag])
    return rows


def draw(log: Log, folder: Path) -> None:
    """Draw the drive: the crank angle, natural frequencies by FMU and node, and the lag."""
    exchange = simulate(folder / "hitch.fmu", "ModelExchange", log, STEPS[0])
    stepped = simulate(folder / "hitch.fmu", "CoSimulation", log, STEPS[1])
    figure = Figure(figsize=(10.0, 8.0), dpi=110, layout="constrained")
    top, middle, bottom = figure.subplots(3, 1, height_ratios=[1.0, 2.0, 1.4])
    top.plot(log.times, np.degrees(log.crank_angle), color=INK)
    top.set(ylabel="crank angle [deg]", title="The shipped drive through FMPy")
    rows = slice(None, None, 60)
    for mode, colour in enumerate(mode_colours(4)):
        own = exchange[f"natural_frequencies[{mode + 1}]"]
        middle.plot(exchange["time"], own, color=colour, label=log.mode_label(mode))
        middle.plot(log.times[rows], log.natural_frequencies[rows, mode], "o", color=colour, ms=4)
    middle.set(ylabel="natural frequency [Hz]", ylim=(0.0, None))
    middle.set_title("lines: FMU, model exchange; dots: predictions of the node", fontsize=9)
    middle.legend(fontsize=8, loc="center left", ncols=2)
    name = "natural_frequencies[4]"
    begin, end = busiest(exchange["time"], exchange[name])
    bottom.plot(exchange["time"], exchange[name], color=mode_colours(4)[3], label="model exchange")
    bottom.step(
        stepped["time"],
        stepped[name],
        where="post",
        color=INK,
        label=f"co-simulation, steps of {STEPS[1]:g} s",
    )
    bottom.set(xlabel="time [s]", ylabel="mode 4 [Hz]", xlim=(begin, end))
    inside = (exchange["time"] >= begin) & (exchange["time"] <= end)
    ends = exchange[name][inside].min(), exchange[name][inside].max()
    room = 0.1 * (ends[1] - ends[0])
    bottom.set_ylim(ends[0] - room, ends[1] + room)
    bottom.set_title("a co-simulation lags one step", fontsize=9)
    bottom.legend(fontsize=8)
    figure.savefig(PICTURE)


def busiest(times: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Return a second in which values change most."""
    rate = np.abs(np.gradient(values, times))
    middle = float(times[int(np.argmax(rate))])
    return middle - 0.5, middle + 0.5


def main() -> None:
    """Measure, simulate, draw and publish."""
    known = tables()
    with tempfile.TemporaryDirectory() as name:
        log = drive_log(Path(name))
        simulated = fmus(Path(name), log)
        draw(log, Path(name))
    publish(
        "export_c",
        "Tables in C and as FMUs",
        [
            "This page compares exported C and FMUs with the predictions of the node.",
            f"Numbers at {ANGLES:,} angles: NaN, infinities, the ends of the range, both sides of "
            "borders of cells, and many turns. The largest difference is that over the largest "
            "number of its kind.",
            table(BIT_COLUMNS, [row for key, of in known.items() for row in bits(key, of)]),
            "Cells, constants, compiled size (gcc -Os), and the time of a call with the crank "
            "moving slowly and at random angles (gcc -O2).",
            table(SIZE_COLUMNS, [sizes(key, of) for key, of in known.items()]),
            "The shipped drive through FMPy, with steps (s): the size of the FMU (kB), "
            "the largest relative difference of natural frequencies from those of the node at the "
            "same time, and for a co-simulation also from those one step before.",
            table(["interface", "step", "kB", "now", "one step before"], simulated),
        ],
        machine("matplotlib", "fmpy", version_of("gcc"), version_of("clang")),
    )


def version_of(compiler: str) -> str:
    """Return a compiler and its version."""
    done = subprocess.run([compiler, "--version"], check=True, capture_output=True, text=True)
    return f"{compiler} {done.stdout.splitlines()[0].split()[-1]}"


if __name__ == "__main__":
    main()
