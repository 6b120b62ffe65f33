# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Predict natural frequencies and the response peak at angles given in degrees."""

import argparse
import math
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("angle_deg", nargs="+", type=float, help="crank angle alpha3 in degrees")
    parser.add_argument("--mechanism", type=Path, help="YAML file (default: the shipped linkage)")
    parser.add_argument("--table", type=Path, help="table to use (default: the shipped one)")


def run(options: argparse.Namespace) -> int:
    """Print one row for each angle; return 1 if one of them has no prediction."""
    from linkage_vibration.mechanics.model import LinkageModel
    from linkage_vibration.prediction.predictor import Predictor, Status
    from linkage_vibration.readers.mechanism import read_mechanism
    from linkage_vibration.support.resources import DEFAULT_MECHANISM, DEFAULT_TABLE, config_file
    from linkage_vibration.table.table import load_table
    from linkage_vibration.table.tabulation import build_table

    mechanism = read_mechanism(options.mechanism or config_file(DEFAULT_MECHANISM))
    if options.mechanism and not options.table:
        table = build_table(LinkageModel(mechanism))
    else:
        table = load_table(options.table or config_file(DEFAULT_TABLE), mechanism)
    predictor = Predictor(table)
    modes = "".join(f"{f'mode {k + 1} [Hz]':>13}" for k in range(table.n_modes))
    print(f"{'alpha3 [deg]':>12}{modes}{'peak [Hz]':>13}{'peak [m/N]':>13}")
    good = True
    for angle in options.angle_deg:
        prediction = predictor.predict(math.radians(angle))
        good = good and prediction.status.has_numbers
        print(
            f"{angle:12.3f}"
            + "".join(f"{frequency:13.4f}" for frequency in prediction.natural_frequencies)
            + f"{prediction.frf_peak_frequency:13.4f}{prediction.frf_peak_magnitude:13.4e}"
            + ("" if prediction.status is Status.OK else f"  {prediction.status.name}")
        )
    return 0 if good else 1
