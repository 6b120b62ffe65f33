# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Show how the loops of a linkage close: the angles of the bodies over the stroke."""

import argparse
import math
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "mechanism", nargs="?", type=Path, help="YAML file (default: the shipped linkage)"
    )
    text = "crank angles in degrees (default: seven over the stroke)"
    parser.add_argument("--at", nargs="+", type=float, metavar="DEG", help=text)
    text = "PNG picture of the linkage to write, at the first angle"
    parser.add_argument("-o", "--output", type=Path, help=text)


def run(options: argparse.Namespace) -> int:
    """Print the angles, and draw the picture; return the exit code."""
    import numpy as np

    from linkage_vibration.mechanics.model import LinkageModel
    from linkage_vibration.prediction.settings import Parameters
    from linkage_vibration.readers.mechanism import read_mechanism
    from linkage_vibration.studies.pose import angle_rows
    from linkage_vibration.support.atomic_files import check_outputs, check_suffix

    source = Parameters(mechanism_file=str(options.mechanism or "")).mechanism_path()
    if options.output:
        check_outputs([options.output], [source])
        check_suffix(options.output, ".png")
    model = LinkageModel(read_mechanism(source))
    mechanism, kinematics = model.mechanism, model.kinematics
    if kinematics.notice:
        print(f"{source}: {kinematics.notice}\n")
    angles = np.radians(options.at or np.degrees(np.linspace(*mechanism.stroke, 7))).tolist()
    print(angle_rows(mechanism, kinematics, angles))
    if kinematics.toggles is not None:
        print("Toggles: " + ", and ".join(map(str, kinematics.toggles)) + ".")
    if options.output:
        from linkage_vibration.drawing.pose_picture import draw_pose

        draw_pose(model, angles[0], options.output)
        print(f"\nWritten: {options.output} at alpha3 = {math.degrees(angles[0]):.2f} deg")
    return 0
