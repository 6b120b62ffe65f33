# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Find natural frequencies in recordings of blows at several heights, and write targets from them.

Each word is the crank angle alpha3 in degrees and a file: a bag with an IMU, or the CSV file of a
phone. `calibrate` fits the mechanism to what this command writes.
"""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = "crank angle in degrees and recording, such as 112.5:low.mcap"
    parser.add_argument("recordings", nargs="+", metavar="ANGLE:FILE", help=text)
    parser.add_argument("--topic", help="IMU in the bags (default: the only one)")
    parser.add_argument("--mechanism", type=Path, help="YAML file (default: the shipped linkage)")
    text = "calibration to write (default: only print the modes)"
    parser.add_argument("-o", "--output", type=Path, help=text)


def run(options: argparse.Namespace) -> int:
    """Print the modes, and write the calibration; return the exit code."""
    from tqdm import tqdm

    from linkage_vibration.mechanics.model import LinkageModel
    from linkage_vibration.prediction.settings import Parameters
    from linkage_vibration.readers.mechanism import read_mechanism
    from linkage_vibration.readers.recordings import read_recording
    from linkage_vibration.studies import measurement as study
    from linkage_vibration.studies.ringdown import RingdownError, measure_modes
    from linkage_vibration.support.atomic_files import check_outputs, check_suffix, write_text

    words = [study.angle_and_path(word) for word in options.recordings]
    mechanism = Parameters(mechanism_file=str(options.mechanism or "")).mechanism_path()
    if options.output:
        check_outputs([options.output], [mechanism, *(path for _, path in words)])
        check_suffix(options.output, ".yaml")
    model = LinkageModel(read_mechanism(mechanism))
    if model.kinematics.notice:
        print(f"{mechanism}: {model.kinematics.notice}\n")
    compared: list[study.ComparedMode] = []
    for alpha3, path in tqdm(words, disable=None, unit="recording", delay=1.0):
        try:
            modes = measure_modes(*read_recording(path, options.topic))
        except RingdownError as error:
            raise RingdownError(f"{path}: {error}") from None
        if not modes:
            raise RingdownError(f"{path}: its decays show no common mode; record more blows.")
        compared += study.compare(model, alpha3, modes)
    print(study.comparison_table(compared, model.mechanism.response.mode_names or ()))
    if options.output:
        text = study.calibration_text(compared, mechanism, options.output)
        write_text(options.output, text, study.MeasurementError)
        print(f"\nWritten: {options.output}")
    return 0
