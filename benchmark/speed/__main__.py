# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures the chart of error against time, and writes its CSV, pictures and tables.

``python -m benchmark.speed --draw`` only draws the pictures again, from the CSV.
"""

import csv
import io
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from benchmark.report import RESULTS, machine, publish, table
from benchmark.speed import assembled, coupled, peers
from benchmark.speed.chart import (
    CONFIGURATION,
    EXACT,
    FRFS,
    INTERPOLATED,
    LIVE,
    PACKAGE,
    Point,
    cycling,
    measure,
    measure_live,
    measure_package,
)
from benchmark.speed.live_picture import draw_live
from benchmark.speed.picture import draw
from benchmark.speed.scene import Scene, standard_scene
from benchmark.speed.timing import Spread, pin_threads, seconds, spread
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.support.atomic_files import write_text
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation import build_table

PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
CSV = RESULTS / "speed.csv"
LOOKUP = "a lookup, s"  # the unit of all costs
_SHOWN = "46 points"  # size of the tables that the page lists for predictions


@dataclass(frozen=True, slots=True)
class Settings:
    """The settings of the methods in one run.

    Attributes
    ----------
    modes : tuple of int
        Numbers of fixed-interface modes per link.
    elements : tuple of int
        Numbers of beam elements per link.
    exudyn_elements : tuple of int
        Numbers of Exudyn's three-node elements per link.
    peer_modes : tuple of int
        Numbers of modes per link for peers that use our reduced links.
    table_points : tuple of int
        Numbers of points of tables.
    tolerances : tuple of float
        Tolerances of the package's own tables.
    rounds : int
        Number of rounds in which each method is timed.
    """

    modes: tuple[int, ...] = (0, 1, 2, 3, 5, 10, 20, 40)
    elements: tuple[int, ...] = (1, 2, 4, 8, 16, 24, 32)
    exudyn_elements: tuple[int, ...] = (4, 8, 16, 32)
    peer_modes: tuple[int, ...] = (3, 10, 20)
    table_points: tuple[int, ...] = (6, 12, 23, 46, 91, 181)
    tolerances: tuple[float, ...] = (1e-4, 1e-6, 1e-8)
    rounds: int = 9


def run(
    scene: Scene,
    settings: Settings,
    with_peers: bool = True,
    progress: Callable[[float], object] = lambda share: None,
) -> list[Point]:
    """Measure every point of the chart.

    Parameters
    ----------
    scene : Scene
        The linkage and its angles.
    settings : Settings
        The settings of the methods.
    with_peers : bool
        Whether other codes are measured, too.
    progress : callable
        Called with shares of the run, whose sum is 1.
    """
    methods = assembled.methods(scene, settings.elements)
    methods += coupled.methods(scene, settings.modes, settings.elements)
    progress(0.05)
    if with_peers:
        methods += peers.methods(scene, settings.exudyn_elements, settings.peer_modes)
    progress(0.05)
    model = scene.model()
    built: list[tuple[Table, int]] = []
    for tolerance in settings.tolerances:
        solved: list[float] = []
        built.append((build_table(model, tolerance, progress=solved.append), len(solved)))
    unit = cycling(build_table(model).interpolate, scene.live_angles)
    points = measure(scene, methods, unit, settings.rounds, lambda share: progress(0.6 * share))
    points += measure_live(
        scene,
        settings.modes[:-1],
        settings.table_points,
        unit,
        settings.rounds,
        lambda share: progress(0.25 * share),
    )
    points += measure_package(scene, built, unit, settings.rounds)
    progress(0.05)
    return points


def seconds_of_a_lookup(scene: Scene, rounds: int) -> Spread:
    """Return the processor time of one lookup in the package's table, s."""
    lookup = cycling(build_table(scene.model()).interpolate, scene.live_angles)
    return spread([seconds(lookup, at_least=5e-3) for _ in range(rounds)])


def as_csv(points: Sequence[Point]) -> str:
    """Return the points as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    cost = [f"cost, {name}" for name in ("median", "lower quartile", "upper quartile")]
    writer.writerow(["answer", "method", "setting", "relative error", *cost, "missing"])
    for p in points:
        numbers = (p.error, p.cost.median, p.cost.low, p.cost.high)
        shown = ["" if math.isnan(x) else f"{x:.4g}" for x in numbers]
        writer.writerow([p.part, p.family, p.setting, *shown, p.missing])
    return text.getvalue()


def read_csv(text: str) -> list[Point]:
    """Return the points in a CSV that `as_csv` wrote."""

    def number(word: str) -> float:
        return float(word) if word else math.nan

    return [
        Point(part, family, setting, number(error), Spread(*map(number, cost)), missing)
        for part, family, setting, error, *cost, missing in list(csv.reader(io.StringIO(text)))[1:]
    ]


def draw_pictures(points: Sequence[Point]) -> None:
    """Draw both pictures; the last of the points has the time of a lookup."""
    lookup = next(p.cost for p in points if p.part == LOOKUP)
    draw(points, lookup.median, PICTURES / "speed_accuracy.png")
    draw_live(points, lookup, PICTURES / "live_prediction.png")


def tables(points: Sequence[Point]) -> list[str]:
    """Return the points as Markdown tables, one for each part."""
    parts = []
    for part in (CONFIGURATION, FRFS):
        own = [p for p in points if p.part == part]
        parts += [f"## The cost of {part}", *_by_settings(own)]
        reasons = dict.fromkeys((p.family, p.missing) for p in own if p.missing)
        parts.append("\n".join(f"- No answer by {family}: {why}." for family, why in reasons))
    shown = [
        [p.family, p.setting, f"{p.error:.1e}", _figures(p.cost.median)]
        for p in points
        if p.part == LIVE and (p.family in (EXACT, PACKAGE) or p.setting == _SHOWN)
    ]
    parts += [f"## The cost of {LIVE}", table(["method", "setting", "error", "lookups"], shown)]
    for part in INTERPOLATED:
        own = [p for p in points if p.part == part and p.family != PACKAGE]
        result = {(p.family, p.cost.median): p.error for p in own}
        sizes = sorted({size for _, size in result})
        rows = [
            [family, *(_error(result.get((family, size), math.nan)) for size in sizes)]
            for family in dict.fromkeys(p.family for p in own)
        ]
        parts += [
            f"## Error of a {part}",
            table(["interpolation", *(f"{size:g} points" for size in sizes)], rows),
        ]
    built = [p for p in points if p.part in INTERPOLATED and p.family == PACKAGE]
    rows = [
        [f"{solves:g}", *(f"{p.error:.1e}" for p in built if p.cost.median == solves)]
        for solves in sorted({p.cost.median for p in built})
    ]
    return [
        *parts,
        "## Error of the package's table",
        table(["solutions", "frequencies", "peak", "whole FRFs"], rows),
    ]


def _by_settings(points: Sequence[Point]) -> list[str]:
    """Return a table for all families that have the same settings."""
    groups: dict[tuple[str, ...], list[str]] = {}
    result = {(p.family, p.setting): p for p in points if not math.isnan(p.error)}
    for family in dict.fromkeys(family for family, _ in result):
        settings = tuple(setting for own, setting in result if own == family)
        groups.setdefault(settings, []).append(family)
    parts = []
    for settings, families in groups.items():
        rows = []
        for family in families:
            own = [result[family, setting] for setting in settings]
            rows.append([family, "error", *(f"{p.error:.1e}" for p in own)])
            rows.append(["", "lookups", *(_figures(p.cost.median) for p in own)])
        parts.append(table(["method", "", *settings], rows))
    return parts


def _error(error: float) -> str:
    return "" if math.isnan(error) else f"{error:.1e}"


def _figures(value: float) -> str:
    """Return three significant digits, without an exponent."""
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"


def main() -> None:
    """Measure everything, and write the CSV, the pictures and the tables."""
    if sys.argv[1:] == ["--draw"]:
        draw_pictures(read_csv(CSV.read_text()))
        return
    pin_threads("benchmark.speed")
    scene, settings = standard_scene(), Settings()
    with tqdm(total=1.0, bar_format="{percentage:3.0f}% |{bar}| {elapsed}") as bar:
        points = run(scene, settings, progress=bar.update)
    lookup = seconds_of_a_lookup(scene, settings.rounds)
    points.append(Point(LOOKUP, PACKAGE, "", math.nan, lookup))
    write_text(CSV, as_csv(points), LinkageVibrationError)
    draw_pictures(points)
    publish(
        "speed",
        "Error against time",
        [
            "This page compares the error and the cost of methods that compute natural frequencies "
            f"and FRFs of `{scene.mechanism.name}`: eleven FRFs on {len(scene.lines)} lines from "
            f"{scene.lines[0]:g} to {scene.lines[-1]:g} Hz. The reference is the same linkage with "
            f"{scene.fine} elements per link, unreduced. Errors are relative: that of the worst of "
            "modes 1 to 3, and that of all eleven FRFs in the L2 norm, each at the worst of "
            f"{len(scene.angles)} angles ({len(scene.live_angles)} for predictions). Costs are "
            "processor times, in units of one lookup of the package's table (here "
            f"{1e6 * lookup.median:.2g} us), timed in the same round. They are medians of "
            f"{settings.rounds} rounds in which the methods take turns, after a warm-up "
            f"(`{CSV.name}` has the quartiles). The cost of a configuration includes its "
            "kinematics and B, but not the reduced links, their FRFs, the meshes and the tables.",
            *tables(points),
        ],
        f"{machine(*peers.installed())}; one BLAS thread",
    )


if __name__ == "__main__":
    main()
