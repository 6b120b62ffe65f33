# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes every number and figure of the paper beside ours: ``python -m benchmark reproduce``."""

import csv
import io
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.paper.figures import draw_figures
from benchmark.paper.numbers import GEOMETRY, SOURCE, Number, frequencies, printed_numbers
from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel, Solution
from linkage_vibration.mechanics.paths import number_at
from linkage_vibration.mechanics.response import pole_residue
from linkage_vibration.readers.mechanism import load_yaml, mechanism_of
from linkage_vibration.support.resources import PAPER_MECHANISM, config_file

FOLDER = Path(__file__).parents[1] / "docs/reproduction"
CORRECTED, PRINTED = "upper link 0.520 m", "as printed, 0.420 m"
PRINTED_FILE = "three_point_linkage_as_printed.yaml"
FILES = {CORRECTED: PAPER_MECHANISM, PRINTED: PRINTED_FILE}
SWEEP: FloatArray = np.radians(np.linspace(90.0, 180.0, 46))
LINES: FloatArray = np.linspace(0.0, 200.0, 2001)  # Hz

_HEAD = f"""\
# Every number of the paper beside ours

{SOURCE}.

Both of our columns use the same sections. The paper prints none, so its frequencies were the
target when our sections were chosen, and agreement proves nothing. Modes 1 and 2 over the stroke
are taken at its ends, where the text says that they begin and end.
"""
_NOTES = """
- Table 2 counts three DoFs for each pin, as eq. 20 to 22 do. The column is of the half in the
  plane, which has two of them. The crank has one more, its rotation at P3.
- Times are for 11 FRFs in 46 configurations on 2001 lines from 0 to 200 Hz. Ours are from this run,
  on planar beams. The paper's are from its own machine, on solid links, and include their
  reduction. They show what each took, but do not compare methods.
- A dash marks a number of the paper's full FE model, which has no counterpart here. The paper
  prints neither cross-sections nor damping.
"""


def main() -> None:
    """Compute both lengths of the upper link over the stroke, and write numbers and figures."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    sweeps, numbers = {}, {}
    for label, name in FILES.items():
        print(f"Computing the stroke: {label}", flush=True)
        mapping = load_yaml(config_file(name))[0]
        sweeps[label], frequencies = _sweep(mechanism_of(mapping, config_file(name)))
        numbers[label] = {**geometry(mapping), **frequencies}
    _write_numbers(FOLDER, numbers)
    draw_figures(FOLDER, sweeps)
    print(f"Written: {FOLDER}")


def geometry(mapping: Any) -> dict[str, float]:
    """Return the numbers of Table 1 as the description of a linkage has them."""
    return {number.key: number_at(mapping, number.place) for number in printed_numbers(GEOMETRY)}


def _sweep(
    mechanism: Mechanism, alpha3: FloatArray = SWEEP
) -> tuple[list[Solution], dict[str, float]]:
    """Return the solutions of a three-point linkage, and our numbers under the printed ones' keys.

    The angles, in rad, lead from one end of the stroke to the other.
    """
    start = time.perf_counter()
    model = LinkageModel(mechanism)
    reduced = time.perf_counter()
    solutions = [model.solve(float(alpha)) for alpha in alpha3]
    for solution in solutions:
        _eleven_frfs(solution)
    finished = time.perf_counter()
    over = np.array([solution.natural_frequencies[:3] for solution in solutions])
    return solutions, {
        **_dofs(mechanism),
        "sweep.start_deg": math.degrees(alpha3[0]),
        "sweep.stop_deg": math.degrees(alpha3[-1]),
        "sweep.step_deg": math.degrees(alpha3[1] - alpha3[0]),
        "band_hz.0": float(LINES[0]),
        "band_hz.1": float(LINES[-1]),
        **frequencies(over, model.solve(math.radians(140.0)).natural_frequencies),
        "timing_s.craig_bampton_reduction": reduced - start,
        "timing_s.substructuring_frf": finished - reduced,
    }


def _write_numbers(output: Path, numbers: Mapping[str, Mapping[str, float]]) -> None:
    """Write ``numbers.csv`` and ``numbers.md``: every printed number beside ours, by its key."""
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    head = [title for name in numbers for title in (name, f"relative difference, {name}")]
    writer.writerow(["key", "source", "quantity", "unit", "printed", *head])
    lines = [
        _HEAD,
        "| where | what | unit | printed |" + "".join(f" {name} | diff. |" for name in numbers),
        "|---|---|---|---:|" + "---:|---:|" * len(numbers),
    ]
    for number in printed_numbers():
        about = [number.source, number.quantity, number.unit]
        cells = [_cells(number, ours.get(number.key)) for ours in numbers.values()]
        exact = [cell for value, difference, _, _ in cells for cell in (value, difference)]
        short = [cell for _, _, value, difference in cells for cell in (value, difference)]
        writer.writerow([number.key, *about, f"{number.value:.9g}", *exact])
        lines.append("| " + " | ".join([*about, f"{number.value:.6g}", *short]) + " |")
    (output / "numbers.csv").write_text(table.getvalue(), encoding="utf-8")
    (output / "numbers.md").write_text("\n".join([*lines, _NOTES]), encoding="utf-8")


def _cells(number: Number, value: float | None) -> tuple[str, str, str, str]:
    """Return our value and its relative difference, for numbers.csv and for numbers.md."""
    if value is None:
        return "", "", "-", "-"
    off = value / number.value - 1.0 if number.value else math.nan
    off = 0.0 if abs(off) < 1e-9 else off
    difference = f"{100.0 * off:+.1f} %"
    if number.key.startswith("timing_s"):
        difference = "another machine"
    elif off == 0.0 or value == number.value:
        difference = "0"
    elif math.isnan(off):
        difference = "-"
    return f"{value:.9g}", "" if math.isnan(off) else f"{off:.6g}", f"{value:.4g}", difference


def _eleven_frfs(solution: Solution) -> ComplexArray:
    """Return FRFs to a force at E1 along z, (n_freq, 11, 1), in m/N and rad/N.

    The responses are x and z of V1, V2, E1 and E2, and x, z and the rotation of the implement's
    centre of gravity; the paper does not say which eleven it used.
    """
    places = [(point, direction) for point in ("V1", "V2", "E1", "E2") for direction in "xz"]
    n = len(solution.model.interface)  # rigid bodies come last
    outputs = np.vstack([solution.participation(places), solution.modes.shapes[n - 3 : n]])
    return pole_residue(solution.damped, outputs, solution.participation([("E1", "z")])).frf(LINES)


def _dofs(mechanism: Mechanism) -> dict[str, float]:
    """Return the numbers of Table 2, those that the planar components have; see the notes."""
    counts: dict[str, float] = {}
    for component in LinkageModel(mechanism).components:
        if isinstance(component, Component):
            plural = component.name in ("lower_link", "input_crank", "lift_rod")
            name = component.name + "s" * plural
            counts[f"reduction.{name}.physical"] = len(component.dofs)
            counts[f"reduction.{name}.modal"] = len(component.mass) - len(component.dofs)
    return counts


if __name__ == "__main__":
    main()
