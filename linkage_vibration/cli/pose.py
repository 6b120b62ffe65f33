# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Show how the loops of a linkage close, and what its lift cylinders, axles and pins carry."""

import argparse
import math
from pathlib import Path

from linkage_vibration.cli.arguments import add_mechanism_and_angles, mechanism_file, read_model


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    add_mechanism_and_angles(parser, "nine over the stroke")
    text = "also print the forces in pins, springs and cylinders under the weight"
    add("--forces", action="store_true", help=text)
    add("-o", "--output", type=Path, help="PNG picture of the linkage to write, at the first angle")


def run(options: argparse.Namespace) -> int:
    """Print the angles, and draw the picture; return the exit code."""
    import numpy as np

    from linkage_vibration.studies.pose import angle_rows, axle_rows, cylinder_rows, force_rows
    from linkage_vibration.support.atomic_files import check_output

    source = mechanism_file(options)
    check_output(options.output, ".png", [source])
    model = read_model(source)
    mechanism, kinematics = model.mechanism, model.kinematics
    nine = np.linspace(*mechanism.stroke, 9)
    angles = np.radians(options.angles_deg or np.degrees(nine)).tolist()
    print(f"{angle_rows(mechanism, kinematics, angles)}\n\n{cylinder_rows(model, angles)}")
    if mechanism.base is not None:
        print("\n" + axle_rows(model, angles))
    if options.forces:
        print("\n" + force_rows(model, angles))
    if kinematics.toggles is not None:
        print("Toggles: " + ", and ".join(map(str, kinematics.toggles)) + ".")
    if options.output:
        from linkage_vibration.drawing.plots import require_matplotlib, write_png
        from linkage_vibration.drawing.pose_picture import pose_figure

        require_matplotlib()
        write_png(pose_figure(model, angles[0]), options.output)
        print(f"\nWritten: {options.output} at alpha3 = {math.degrees(angles[0]):.2f} deg")
    return 0
