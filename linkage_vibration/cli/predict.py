# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Predict natural frequencies and the response peak at angles given in degrees."""

import argparse
import math
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from linkage_vibration.cli.arguments import (
    add_implement_mass,
    add_mechanism_and_angles,
    read_settings,
    read_variants,
)

if TYPE_CHECKING:
    from linkage_vibration.prediction.predictor import Predictor, Shares

_WIDTH, _COLUMN = 100, 12  # characters of a line, and of a column in it


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    add_mechanism_and_angles(parser, "nine over the stroke")
    add_implement_mass(parser)
    text = "also print the standard deviations, and the share of each of their causes"
    add("--shares", action="store_true", help=text)
    text = "standard deviation of the angle in degrees, for --shares (default: %(default)s)"
    add("--angle-stddev-deg", type=_deviation, default=0.0, metavar="DEG", help=text)
    add("--csv", type=Path, help="CSV file of the predictions to write")


def run(options: argparse.Namespace) -> int:
    """Print one column for each angle; return 1 if one of them has no prediction."""
    import numpy as np

    from linkage_vibration.messages.csv_tables import prediction_table, table_text
    from linkage_vibration.prediction.predictor import Predictor
    from linkage_vibration.support.atomic_files import OutputError, check_output, write_text
    from linkage_vibration.table.table import load_table

    source, masses = options.mechanism, options.implement_mass
    check_output(options.csv, ".csv", list(filter(None, [source])))
    if options.csv and len(masses) > 1:
        raise OutputError("--csv has the predictions of one mass; give --implement-mass one.")
    if source is not None and source.suffix == ".npz" and not masses:
        predictors = [Predictor(load_table(source))]
    else:
        predictors = [each.predictor for each in read_variants(read_settings(options), masses)]
    predictor = predictors[0]
    nine = np.linspace(*predictor.table.alpha3_range, 9)
    degrees = options.angles_deg or np.degrees(nine).tolist()
    good, peaks = True, np.empty((0, len(degrees)))
    for i, each in enumerate(predictors):
        if len(masses) > 1:
            print(f"With {masses[i]:.5g} kg:")
        good = _print(each, degrees, options) and good
        peaks = np.vstack([peaks, each.predict(np.radians(degrees)).frf_peak_magnitude])
    if len(masses) > 1 and np.isfinite(peaks).any():
        i, j = divmod(int(np.nanargmax(peaks)), len(degrees))
        where = f"at {degrees[j]:.5g} deg with {masses[i]:.5g} kg"
        print(f"The largest peak of these masses is {peaks[i, j]:.4e} m/N, {where}.")
    reason = predictor.table.unknown_deviations
    if options.csv:
        many = predictor.predict(np.radians(degrees), math.radians(options.angle_stddev_deg))
        columns = {name: each for name, each in vars(many).items() if name != "table_id"}
        table = {"crank_angle_deg": np.array(degrees)} | prediction_table(columns, reason)
        write_text(options.csv, table_text(table), OutputError)
        print(f"Written: {options.csv}")
    return 0 if good else 1


def _print(predictor: "Predictor", degrees: list[float], options: argparse.Namespace) -> bool:
    """Print the predictions of a table; return whether all have numbers."""
    from linkage_vibration.prediction.predictor import Status, fault

    table = predictor.table
    labels = [table.mode_label(mode) for mode in range(table.n_modes)]
    predictions = [predictor.predict(math.radians(angle)) for angle in degrees]
    rows = ["alpha3 [deg]", *(f"{label} [Hz]" for label in labels), "peak [Hz]", "peak [m/N]"]
    columns = []
    for angle, each in zip(degrees, predictions, strict=True):
        missing = "overdamped" if each.status.has_numbers else "nan"
        numbers = each.natural_frequencies
        found = [missing if math.isnan(number) else f"{number:.4f}" for number in numbers]
        peak = [f"{each.frf_peak_frequency:.4f}", f"{each.frf_peak_magnitude:.4e}"]
        columns.append([f"{angle:.3f}", *found, *peak])
    print_columns(rows, columns)
    for angle, each in zip(degrees, predictions, strict=True):
        problem = fault(each, table.alpha3_range)
        sentence = f". The {problem}.".replace("?.", "?") if problem else ""
        if each.status is not Status.OK or sentence:
            print(f"At {angle:.7g} deg: {each.status.name}{sentence}")
        if options.shares and each.status.has_numbers:
            stddev = math.radians(options.angle_stddev_deg)
            _print_shares(predictor.shares(math.radians(angle), stddev), labels, angle)
    if reason := table.unknown_deviations:
        print(reason)
    return all(each.status.has_numbers for each in predictions)


def print_columns(rows: list[str], columns: list[list[str]]) -> None:
    """Print names of rows and the columns beside them, as many as fit beside one another."""
    width = max(map(len, rows))
    several = max((_WIDTH - width) // _COLUMN, 1)
    for start in range(0, len(columns), several):
        for name, *words in zip(rows, *columns[start : start + several], strict=True):
            print(f"{name:<{width}}" + "".join(f"{word:>{_COLUMN}}" for word in words))


def _deviation(text: str) -> float:
    """Return a standard deviation, which is not negative."""
    with suppress(ValueError):
        if 0.0 <= float(text) < math.inf:
            return float(text)
    raise argparse.ArgumentTypeError(f"{text!r} is no standard deviation; give 0 or more.")


def _print_shares(shares: "Shares", labels: list[str], angle: float) -> None:
    """Print the standard deviations at an angle, degrees, and what each cause contributes."""
    for i, quantity in enumerate(("natural frequencies [Hz]", "damping ratios [1]")):
        print(f"Standard deviations of the {quantity} at {angle:.7g} deg by")
        columns = [
            [cause, *(f"{value:.3g}" for value in getattr(shares, cause)[i].tolist())]
            for cause in ("parameters", "angle", "links", "table", "total")
        ]
        print_columns(["", *labels], columns)
