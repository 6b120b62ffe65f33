# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Angles at and beyond the edges of a table, wrong revolutions, wrong and damaged files."""

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from benchmark.report import table
from benchmark.stability.static_limit import linkage
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.predictor import Predictor, Status, fault
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import Table, TableError, load_table, save_table
from linkage_vibration.table.tabulation import build_table

TITLE = "The table's edges, and files that are not what they seem"

_STEP = math.radians(2.0)  # of the plain table


def section(pictures: Path) -> str:
    """Test angles outside the table, tables of another mechanism and damaged tables, and report."""
    model = linkage()
    predictor = Predictor(build_table(model))
    low, high = predictor.table.alpha3_range
    turn = 2.0 * math.pi
    angles = {
        "the first angle": low,
        "the last angle": high,
        "one ulp below": math.nextafter(low, 0.0),
        "one ulp above": math.nextafter(high, 4.0),
        "5 deg above": high + math.radians(5.0),
        "20 deg above": high + math.radians(20.0),
        "a turn off": 2.0 + turn,
        "NaN": math.nan,
    }
    columns = ["angle", "clamped", "extrapolated", "ours"]
    rows = [[name, *_errors(model, predictor, angle)] for name, angle in angles.items()]
    crank = Predictor(build_table(LinkageModel(read_mechanism(config_file("four_bar.yaml"))), 1e-4))
    apart = np.subtract(
        crank.predict(1.0 - 3.0 * turn).natural_frequencies, crank.predict(1.0).natural_frequencies
    )
    return f"""\
The table shows the largest relative error of three natural frequencies of the paper's linkage, 90
to 180 deg. Clamped is `numpy.interp` on 2 deg steps, which silently repeats the end values.
Extrapolated is a cubic spline on the same steps.

{table(columns, rows)}

- If an angle is wrong by one revolution, because the encoder wraps elsewhere, the error says so:
  "{_message(predictor, 2.0 + turn)}".
- If a crank can rotate completely, its table covers one revolution and is used for every
  revolution. Three revolutions earlier, its frequencies differ by {np.abs(apart).max():.0e} Hz.
- A table of another mechanism is rejected: "{_foreign(model)}"
{_damage(model)}

Tests: `test/prediction/test_predictor.py`, `test/table/test_table.py`
`::test_table_of_another_mechanism_is_refused`, `::test_damage_in_any_byte_is_refused`,
`::test_number_changed_on_purpose_is_refused`,
`::test_pickles_are_refused`, and 8000 damaged tables in `make bench ONLY=fuzz`.
"""


def _errors(model: LinkageModel, predictor: Predictor, angle: float) -> list[str]:
    """Return the errors of common tables at an angle, and the error or the status of ours."""
    low, high = predictor.table.alpha3_range
    grid = np.arange(low, high + _STEP / 2.0, _STEP)
    values = np.array([model.solve(float(a)).natural_frequencies[:3] for a in grid])
    clamped = np.array([np.interp(angle, grid, column) for column in values.T])
    extended = CubicSpline(grid, values)(angle)
    prediction = predictor.predict(angle)
    if math.isnan(angle):
        return ["NaN", "NaN", prediction.status.name]
    same = angle - 2.0 * math.pi if angle > 2.0 * math.pi else angle
    exact = model.solve(same).natural_frequencies[:3]
    texts = [f"{np.abs(np.sort(each) / exact - 1.0).max():.0e}" for each in (clamped, extended)]
    if prediction.status is Status.OK:
        error = np.abs(np.sort(prediction.natural_frequencies) / exact - 1.0).max()
        return [*texts, f"{error:.0e}"]
    return [*texts, prediction.status.name]


def _message(predictor: Predictor, angle: float) -> str:
    return fault(predictor.predict(angle), predictor.table.alpha3_range)


def _foreign(model: LinkageModel) -> str:
    """Return the error for a table of the as-printed linkage."""
    printed = read_mechanism(config_file("three_point_linkage_as_printed.yaml"))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "printed.npz"
        save_table(build_table(LinkageModel(printed), 1e-3), path)
        try:
            load_table(path, model.mechanism)
        except TableError as error:
            return str(error).replace(f"{folder}/", "")
    raise AssertionError("a foreign table was not refused")


def _damage(model: LinkageModel) -> str:
    """Flip a bit of each byte of a small table, saved as plain numbers and as ours."""
    smallest = _bare(build_table(model, 0.5))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "frequencies.npy"
        np.save(path, smallest.natural_frequencies)
        plain = bytearray(path.read_bytes())
        silent = 0
        for at in range(len(plain)):
            damaged = plain.copy()
            damaged[at] ^= 1 << at % 8
            path.write_bytes(damaged)
            try:
                result = np.load(path)
            except Exception:
                continue
            silent += not np.array_equal(result, smallest.natural_frequencies)
        ours = Path(folder) / "table.npz"
        save_table(smallest, ours)
        sound = bytearray(ours.read_bytes())
        refused = other = 0
        for at in range(len(sound)):
            damaged = sound.copy()
            damaged[at] ^= 1 << at % 8
            ours.write_bytes(damaged)
            try:
                other += load_table(ours).checksum != smallest.checksum
            except TableError:
                refused += 1
    return f"""\
- Damage: one bit was flipped in each byte of a small table, one byte at a time. In an `.npy` file,
  {silent} of {len(plain)} flips silently load other numbers. Of {len(sound)} flips in ours,
  {refused} are rejected, {other} load other numbers, and {len(sound) - refused - other} are in
  bytes that contain no number, so the table is the same."""


def _bare(whole: Table) -> Table:
    """Return a table without FRFs, which is small."""
    return replace(
        whole,
        places=(),
        forces=(),
        reduced=(),
        static_forces=np.empty(0),
        cell_starts=whole.cell_starts[:1],
        cell_cubics=whole.cell_cubics[:1],
        cell_poles=np.empty(0, complex),
    )
