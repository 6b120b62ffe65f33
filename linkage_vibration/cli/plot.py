# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draw a mechanism over its stroke: modes, orders, and the load ratio over height and speed."""

import argparse
from pathlib import Path

from linkage_vibration.cli.arguments import add_mechanism_and_angles, read_levels, read_settings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    add_mechanism_and_angles(parser, "the stroke; else from the least to the largest one")
    add("--excitations", type=Path, help="YAML file (default: the shipped excitations)")
    text = "PNG picture or HTML page to write (default: MECHANISM with .png, in this folder)"
    add("-o", "--output", type=Path, help=text)


def run(options: argparse.Namespace) -> int:
    """Draw the picture or the page, and print where loads are largest; return the exit code."""
    import numpy as np

    from linkage_vibration.drawing.mechanism_picture import draw_mechanism
    from linkage_vibration.drawing.plots import png_bytes, require_matplotlib
    from linkage_vibration.review.html import picture_tag, plain_html
    from linkage_vibration.support.atomic_files import OutputError, check_outputs, write_bytes

    files, angles = (options.mechanism, options.excitations), np.radians(options.angles_deg)
    settings = read_settings(options, excitation_file=options.excitations)
    output = options.output or Path(settings.mechanism_path().with_suffix(".png").name)
    check_outputs([output], list(filter(None, files)))
    if output.suffix.lower() not in (".png", ".html"):
        raise OutputError(f"{output}: a plot is a .png or an .html file; use one of these endings.")
    if len({*angles.tolist()}) == 1:
        raise OutputError("A plot of one crank angle has no width; give two, or leave it out.")
    require_matplotlib()
    served, excitations, levels = read_levels(settings)
    limit = settings.warning_limits().warning
    ends = (angles.min(), angles.max()) if len(angles) else levels.alpha3_range
    figure, sentences = draw_mechanism(served.predictor, levels, excitations, limit, ends)
    print("\n".join(sentences))
    content = png_bytes(figure)
    if output.suffix.lower() == ".html":
        picture = picture_tag(content, " ".join(sentences))
        content = plain_html(served.mechanism.name, sentences, picture).encode()
    write_bytes(output, content, OutputError)
    print(f"Written: {output}")
    return 0
