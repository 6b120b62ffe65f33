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
    if len(masses) > 1 and (options.csv or options.shares):
        raise OutputError("--csv and --shares are those of one mass; give --implement-mass one.")
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
    good = _print(predictors, degrees, options)
    reason = predictor.table.unknown_deviations
    if options.csv:
        many = predictor.predict(np.radians(degrees), math.radians(options.angle_stddev_deg))
        columns = {name: each for name, each in vars(many).items() if name != "table_id"}
        table = {"crank_angle_deg": np.array(degrees)} | prediction_table(columns, reason)
        write_text(options.csv, table_text(table), OutputError)
        print(f"Written: {options.csv}")
    return 0 if good else 1


def _print(
    predictors: "list[Predictor]", degrees: list[float], options: argparse.Namespace
) -> bool:
    """Print the predictions of tables, one for each mass; return whether all have numbers."""
    import numpy as np

    from linkage_vibration.prediction.predictor import Status, fault

    predictor, masses = predictors[0], [f"{mass:.5g}" for mass in options.implement_mass]
    several, modes = len(predictors) > 1, range(predictor.table.n_modes)
    heads = [f"mode {k + 1} [Hz]" for k in modes] + ["peak [Hz]", "peak [m/N]"]
    heads, width = [*heads, *["mass [kg]"] * several], 20 if several else 13
    print(f"{'alpha3 [deg]':>12}" + "".join(f"{head:>{width}}" for head in heads))
    good = True
    for angle in degrees:
        each = [of.predict(math.radians(angle)) for of in predictors]
        worst = int(np.argmax([of.frf_peak_magnitude for of in each]))  # the first NaN, if any
        prediction = each[worst]
        good = good and prediction.status.has_numbers
        missing = "overdamped" if prediction.status.has_numbers else "nan"
        cells = [_span([of.natural_frequencies[k] for of in each], missing) for k in modes]
        cells += [f"{prediction.frf_peak_frequency:.4f}", f"{prediction.frf_peak_magnitude:.4e}"]
        row = "".join(f"{cell:>{width}}" for cell in [*cells, *masses[worst:][:several]])
        status = "" if prediction.status is Status.OK else f"  {prediction.status.name}"
        print(f"{angle:12.3f}{row}{status}")
        if problem := fault(prediction, predictor.table.alpha3_range):
            print(f"  The {problem}.".replace("?.", "?"))
        if options.shares:
            stddev = math.radians(options.angle_stddev_deg)
            print(_described(predictor.shares(math.radians(angle), stddev)))
    if reason := predictor.table.unknown_deviations:
        print(reason)
    return good


def _span(values: list[float], missing: str) -> str:
    """Return a number, or the smallest and the largest one of several masses."""
    if any(map(math.isnan, values)):
        return missing
    if len(values) == 1:
        return f"{values[0]:.4f}"
    return f"{min(values):.4g} to {max(values):.4g}"


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
