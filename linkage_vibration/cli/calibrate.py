# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Fit a mechanism to measured natural frequencies, or the sensor of the hitch to an inclinometer.

For the sensor, give --times or --readings. Each point is a moment in the bag at which the hitch was
at rest, in seconds after the first reading, or a reading of the sensor itself, with the angle that
the inclinometer showed. Angles are in degrees, positive where the end ahead, towards the front, is
higher.
"""

import argparse
from pathlib import Path
from typing import Any

from linkage_vibration.cli.arguments import add_inputs, read_model, read_settings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    text = "YAML file of parameters and targets; for --times, the bags of the sensor instead"
    add("files", nargs="*", type=Path, metavar="FILE", help=text)
    text = "mechanism, or parameters of the sensor, to write (default: only print the fit)"
    add("-o", "--output", type=Path, help=text)
    text = "number of starting points of the search for a mechanism (default: %(default)s)"
    add("--starts", type=int, default=8, help=text)
    sensor = parser.add_argument_group("the sensor of the hitch")
    points: dict[str, Any] = {"nargs": "+", "action": "extend", "default": []}
    text = "moments in the bag and angles, such as 12.5=-38.2"
    sensor.add_argument("--times", **points, metavar="S=DEG", help=text)
    text = "readings and angles, such as 43.2=-38.2"
    sensor.add_argument("--readings", **points, metavar="READING=DEG", help=text)
    text = "body along which the inclinometer lies (default: the input crank, the lift arm)"
    sensor.add_argument("--body", help=text)
    text = "inclination of the tractor itself in degrees, positive where its front is higher"
    sensor.add_argument("--tractor-deg", type=float, default=0.0, help=f"{text} (%(default)s)")
    text = "standard deviation of an angle that the inclinometer shows, in degrees"
    sensor.add_argument("--stddev-deg", type=float, default=0.5, help=f"{text} (%(default)s)")
    add_inputs(sensor)


def run(options: argparse.Namespace) -> int:
    """Fit, print the fit, and write what was fitted; return the exit code."""
    from tqdm import tqdm

    from linkage_vibration.studies import calibration as study
    from linkage_vibration.support.atomic_files import check_output

    if options.times or options.readings:
        return _calibrate_sensor(options)
    if len(options.files) != 1:
        other = "for the sensor of the hitch --times or --readings"
        raise study.CalibrationError(f"Give one YAML file of parameters and targets, or {other}.")
    [source], starts = options.files, options.starts
    if starts < 1:
        raise study.CalibrationError(f"--starts is {starts}; give 1 or more starting points.")
    check_output(options.output, ".yaml", [source])
    calibration = study.read_calibration(source)
    with tqdm(disable=None, total=starts, unit="start") as bar:

        def show(cost: float) -> None:
            bar.set_postfix(cost=f"{cost:.4g}")
            bar.update(1)

        result = study.calibrate(calibration, starts, show)
    print(study.fit_report(calibration, result))
    if options.output:
        study.write_mechanism(calibration, result, options.output)
        print(f"\nWritten: {options.output}")
    return 0


def _calibrate_sensor(options: argparse.Namespace) -> int:
    """Print the calibration and its residuals, and write the parameters; return the exit code."""
    from linkage_vibration.playback.readings import read_numbers
    from linkage_vibration.playback.remapping import remappings
    from linkage_vibration.prediction.inputs.presets import HITCH, PRESETS
    from linkage_vibration.prediction.inputs.units import CALIBRATED
    from linkage_vibration.studies import inclinometer as study
    from linkage_vibration.support.atomic_files import check_output, write_text

    if options.times and not options.files:
        raise study.InclinometerError("--times needs the bag in which the moments are; give it.")
    settings = read_settings(options, joint_name=options.joint)
    source = settings.mechanism_path()
    inputs = [source, *options.files, *filter(None, [options.params_file])]
    check_output(options.output, ".yaml", inputs)
    mechanism = read_model(source).mechanism
    unit = settings.hitch_unit or PRESETS[HITCH][settings.hitch_input].unit
    series = None
    if options.files:
        series = read_numbers(options.files, settings, remappings(options.remap))
    words = options.times, options.readings
    body, angles = options.body or mechanism.input_body, (options.tractor_deg, options.stddev_deg)
    line, report = study.calibrate(mechanism, body, unit, *words, series, *angles)
    text = study.parameters(line, unit if unit in CALIBRATED else "any")
    print(f"{report}\n\n{text}", end="")
    if options.output:
        write_text(options.output, text, study.InclinometerError)
        print(f"\nWritten: {options.output}")
    return 0
