# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Calibrate the hitch sensor with an inclinometer, and print the parameters of the node.

Each point is a moment in the bag at which the hitch was at rest, in seconds after the first reading
(--times), or a reading of the sensor itself (--readings), with the angle that the inclinometer
showed. Angles are in degrees, positive where the end ahead, towards the front, is higher.
"""

import argparse
from pathlib import Path

from linkage_vibration.cli.arguments import add_inputs, read_model, read_settings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    text = "bag with readings of the sensor, needed for --times"
    add("bags", nargs="*", type=Path, metavar="BAG", help=text)
    text = "moments in the bag and angles, such as 12.5=-38.2"
    add("--times", nargs="+", action="extend", default=[], metavar="S=DEG", help=text)
    text = "readings and angles, such as 43.2=-38.2"
    add("--readings", nargs="+", action="extend", default=[], metavar="READING=DEG", help=text)
    text = "body along which the inclinometer lies (default: the input crank, the lift arm)"
    add("--body", help=text)
    text = "inclination of the tractor itself in degrees, positive where its front is higher"
    add("--tractor-deg", type=float, default=0.0, help=f"{text} (%(default)s)")
    text = "standard deviation of an angle that the inclinometer shows, in degrees"
    add("--stddev-deg", type=float, default=0.5, help=f"{text} (%(default)s)")
    add_inputs(parser)
    text = "YAML file of parameters to write (default: only print them)"
    add("-o", "--output", type=Path, help=text)


def run(options: argparse.Namespace) -> int:
    """Print the calibration and its residuals, and write the parameters; return the exit code."""
    from linkage_vibration.playback.readings import read_numbers
    from linkage_vibration.playback.remapping import remappings
    from linkage_vibration.prediction.inputs.presets import HITCH, PRESETS
    from linkage_vibration.prediction.inputs.units import CALIBRATED
    from linkage_vibration.studies import inclinometer as study
    from linkage_vibration.support.atomic_files import check_output, write_text

    if options.times and not options.bags:
        raise study.InclinometerError("--times needs the bag in which the moments are; give it.")
    settings = read_settings(options, joint_name=options.joint)
    source = settings.mechanism_path()
    inputs = [source, *options.bags, *filter(None, [options.params_file])]
    check_output(options.output, ".yaml", inputs)
    mechanism = read_model(source).mechanism
    unit = settings.hitch_unit or PRESETS[HITCH][settings.input].unit
    series = None
    if options.bags:
        series = read_numbers(options.bags, settings, remappings(options.remap))
    words = options.times, options.readings
    body, angles = options.body or mechanism.input_body, (options.tractor_deg, options.stddev_deg)
    line, report = study.calibrate(mechanism, body, unit, *words, series, *angles)
    text = study.parameters(line, unit if unit in CALIBRATED else "any")
    print(f"{report}\n\n{text}", end="")
    if options.output:
        write_text(options.output, text, study.InclinometerError)
        print(f"\nWritten: {options.output}")
    return 0
