# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Find natural frequencies in recordings of blows at several heights, and write targets from them.

Each word is the crank angle alpha3 in degrees and a file: a bag with an IMU, or the CSV file of a
phone. `calibrate` fits the mechanism to what this command writes.
"""

import argparse
import math
import os
from dataclasses import replace
from pathlib import Path

from linkage_vibration.cli.arguments import add_mechanism, mechanism_file, read_model


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    text = "crank angle in degrees and recording, such as 112.5:low.mcap"
    add("recordings", nargs="+", metavar="ANGLE:FILE", help=text)
    add("--topic", help="IMU in the bags (default: the only one)")
    add_mechanism(parser)
    text = "the sensor has an anti-aliasing filter, so that no mode is folded"
    add("--filtered", action="store_true", help=text)
    add("-o", "--output", type=Path, help="calibration to write (default: only print the modes)")


def run(options: argparse.Namespace) -> int:
    """Print the modes, and write the calibration; return the exit code."""
    from tqdm import tqdm

    from linkage_vibration.mechanics.model import LinkageModel
    from linkage_vibration.readers.recordings import read_recording, shows_sides, vibrating
    from linkage_vibration.studies import measurement as study
    from linkage_vibration.studies.ringdown import RingdownError, measure_modes, sampling_rate
    from linkage_vibration.support.atomic_files import check_output, write_text

    words = [study.angle_and_path(word) for word in options.recordings]
    for i, (_, path) in enumerate(words):
        if any(os.path.realpath(path) == os.path.realpath(other) for _, other in words[:i]):
            raise study.MeasurementError(f"{path} is given twice; give each recording once.")
    mechanism = mechanism_file(options)
    check_output(options.output, ".yaml", [mechanism, *(path for _, path in words)])
    both = read_model(mechanism)
    alone = LinkageModel(replace(both.mechanism, lateral=None), kinematics=both.kinematics)
    compared: list[study.ComparedMode] = []
    notes, rate = list[str](), math.inf
    for alpha3, path in tqdm(words, disable=None, unit="recording", delay=1.0):
        times, signals = read_recording(path, options.topic)
        signals, left_out = vibrating(signals)
        notes += [f"{path}: {text}" for text in left_out]
        model = both if shows_sides(path) else alone
        try:
            modes = measure_modes(times, signals)
        except RingdownError as error:
            raise RingdownError(f"{path}: {error}") from None
        if not options.filtered:
            own = sampling_rate(times)
            rate, modes = min(rate, own), study.doubt_folds(modes, model, alpha3, own)
        sure = [mode for mode in modes if not mode.doubt]
        if not sure:
            notes.append(f"{path}: its decays show no mode that is sure; record more blows.")
        compared += study.compare(model, alpha3, sure)
        notes += [
            f"{math.degrees(alpha3):.2f} deg: {mode.frequency:.3f} Hz is not sure: {mode.doubt}."
            for mode in modes
            if mode.doubt
        ]
    if len({alpha3 for alpha3, _ in words}) < len(words):
        notes.append(
            "Recordings at one angle share its error, so each mode there is one target: the surest."
        )
    if not compared:
        raise RingdownError(" ".join(notes))
    print(study.comparison_table(compared))
    if notes:
        print("", *notes, sep="\n")
    if not options.filtered:
        print(
            f"\nWithout an anti-aliasing filter, modes above {rate / 2.0:.4g} Hz appear below it, "
            "also some that the model does not have. If the sensor has a filter, give --filtered."
        )
    if options.output:
        text = study.calibration_text(compared, mechanism, options.output)
        write_text(options.output, text, study.MeasurementError)
        print(f"\nWritten: {options.output}")
    return 0
