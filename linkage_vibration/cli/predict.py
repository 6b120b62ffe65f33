# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Predict natural frequencies and the response peak at angles given in degrees."""

import argparse
import math
import textwrap
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
    """Print one row for each angle; return 1 if one of them has no prediction."""
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
    if predictor.table.lateral:
        labels = map(predictor.table.mode_label, range(predictor.table.n_modes))
        print(textwrap.fill(", ".join(labels), 100))
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

    modes = "".join(f"{f'mode {k + 1} [Hz]':>13}" for k in range(predictor.table.n_modes))
    print(f"{'alpha3 [deg]':>12}{modes}{'peak [Hz]':>13}{'peak [m/N]':>13}")
    good = True
    for angle in degrees:
        prediction = predictor.predict(math.radians(angle))
        good = good and prediction.status.has_numbers
        missing = "overdamped" if prediction.status.has_numbers else "nan"
        natural = prediction.natural_frequencies
        cells = [f"{missing:>13}" if math.isnan(hertz) else f"{hertz:13.4f}" for hertz in natural]
        peak = f"{prediction.frf_peak_frequency:13.4f}{prediction.frf_peak_magnitude:13.4e}"
        status = "" if prediction.status is Status.OK else f"  {prediction.status.name}"
        print(f"{angle:12.3f}{''.join(cells)}{peak}{status}")
        if problem := fault(prediction, predictor.table.alpha3_range):
            print(f"  The {problem}.".replace("?.", "?"))
        if options.shares:
            stddev = math.radians(options.angle_stddev_deg)
            print(_described(predictor.shares(math.radians(angle), stddev)))
    if reason := predictor.table.unknown_deviations:
        print(reason)
    return good


def _deviation(text: str) -> float:
    """Return a standard deviation, which is not negative."""
    with suppress(ValueError):
        if 0.0 <= float(text) < math.inf:
            return float(text)
    raise argparse.ArgumentTypeError(f"{text!r} is no standard deviation; give 0 or more.")


def _described(shares: "Shares") -> str:
    """Return the standard deviations, and what each cause contributes to them."""
    lines = []
    for i, quantity in enumerate(("natural frequencies [Hz]", "damping ratios [1]")):
        lines.append(f"  standard deviations of the {quantity} by")
        for cause in ("parameters", "angle", "links", "table", "total"):
            values = getattr(shares, cause)[i].tolist()
            name = "all together" if cause == "total" else cause
            lines.append(f"{name:>12}" + "".join(f"{value:13.3g}" for value in values))
    return "\n".join(lines)
