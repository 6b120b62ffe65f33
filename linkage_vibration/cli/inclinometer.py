# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Calibrate the hitch sensor with an inclinometer, and print the parameters of the node.

Each point is a moment in the bag at which the hitch was at rest, in seconds after the first reading
(--times), or a reading of the sensor itself (--readings), with the angle that the inclinometer
showed. Angles are in degrees, positive where the end ahead, towards the front, is higher.
"""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    text = "bag with readings of the sensor, needed for --times"
    parser.add_argument("bags", nargs="*", type=Path, metavar="BAG", help=text)
    text = "moments in the bag and angles, such as 12.5=-38.2"
    parser.add_argument(
        "--times", nargs="+", action="extend", default=[], metavar="S=DEG", help=text
    )
    text = "readings and angles, such as 43.2=-38.2"
    parser.add_argument(
        "--readings", nargs="+", action="extend", default=[], metavar="READING=DEG", help=text
    )
    text = "body along which the inclinometer lies (default: the input crank, the lift arm)"
    parser.add_argument("--body", help=text)
    text = "inclination of the tractor itself in degrees, positive where its front is higher"
    parser.add_argument("--tractor-deg", type=float, default=0.0, help=f"{text} (%(default)s)")
    text = "standard deviation of an angle that the inclinometer shows, in degrees"
    parser.add_argument("--stddev-deg", type=float, default=0.5, help=f"{text} (%(default)s)")
    parser.add_argument("--mechanism", type=Path, help="YAML file (default: the shipped linkage)")
    text = "YAML file of the node's parameters, which say where the readings come from"
    parser.add_argument("--params-file", type=Path, help=text)
    parser.add_argument("--joint", help="joint (default: the parameter joint_name)")
    text = "topic in the bags for one of the node, such as joint_states:=/arm/joint_states"
    parser.add_argument("--remap", nargs="+", default=[], metavar="NAME:=TOPIC", help=text)
    text = "YAML file of parameters to write (default: only print them)"
    parser.add_argument("-o", "--output", type=Path, help=text)


def run(options: argparse.Namespace) -> int:
    """Print the calibration and its residuals, and write the parameters; return the exit code."""
    from linkage_vibration.mechanics.kinematics import Kinematics
    from linkage_vibration.playback.readings import read_numbers
    from linkage_vibration.playback.remapping import remappings
    from linkage_vibration.prediction.inputs.presets import HITCH, PRESETS
    from linkage_vibration.prediction.inputs.units import CALIBRATED
    from linkage_vibration.prediction.parameter_files import read_parameters
    from linkage_vibration.prediction.settings import Parameters, with_values
    from linkage_vibration.readers.mechanism import read_mechanism
    from linkage_vibration.studies import inclinometer as study
    from linkage_vibration.support.atomic_files import check_outputs, check_suffix, write_text

    if options.times and not options.bags:
        raise study.InclinometerError("--times needs the bag in which the moments are; give it.")
    settings = read_parameters(options.params_file) if options.params_file else Parameters()
    given = {"joint_name": options.joint, "mechanism_file": options.mechanism}
    settings = with_values(settings, {name: str(v) for name, v in given.items() if v is not None})
    source = settings.mechanism_path()
    if options.output:
        inputs = [source, *options.bags, *filter(None, [options.params_file])]
        check_outputs([options.output], inputs)
        check_suffix(options.output, ".yaml")
    mechanism = read_mechanism(source)
    kinematics = Kinematics(mechanism)
    if kinematics.notice:
        print(f"{source}: {kinematics.notice}\n")
    body = options.body or mechanism.input_body
    scene = study.Inclinometer(mechanism, kinematics, body, options.tractor_deg, options.stddev_deg)
    series = None
    if options.bags:
        series = read_numbers(options.bags, settings, remappings(options.remap))
    unit = settings.hitch_unit or PRESETS[HITCH][settings.input].unit
    fit = study.calibrate(scene, options.times, options.readings, series, unit)
    print(study.curve_report(fit, body))
    text = study.parameters(fit, unit if unit in CALIBRATED else "any")
    print(f"\n{text}", end="")
    if options.output:
        write_text(options.output, text, study.InclinometerError)
        print(f"\nWritten: {options.output}")
    return 0
