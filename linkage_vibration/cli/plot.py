# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draw a mechanism over its stroke: modes, orders, and the load ratio over height and speed."""

import argparse
from html import escape
from pathlib import Path

from linkage_vibration.cli.arguments import (
    add_implement_mass,
    add_mechanism_and_angles,
    read_levels,
    read_settings,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    add_mechanism_and_angles(parser, "the stroke; else from the least to the largest one")
    add_implement_mass(parser)
    add("--excitations", type=Path, help="YAML file (default: the shipped excitations)")
    text = "PNG picture or HTML page to write (default: MECHANISM with .png, in this folder)"
    add("-o", "--output", type=Path, help=text)


def run(options: argparse.Namespace) -> int:
    """Draw the picture or the page, and print loads and crossings; return the exit code."""
    import numpy as np

    from linkage_vibration.drawing.mechanism_picture import draw_mechanism, drawn_speeds
    from linkage_vibration.drawing.plots import png_bytes, require_matplotlib
    from linkage_vibration.review.html import picture_tag, plain_html, table_tag
    from linkage_vibration.studies.crossings import crossing_table, crossing_text, find_crossings
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
    served, excitations, every = read_levels(settings, options.implement_mass)
    limit = settings.warning_limits().warning
    ends = (angles.min(), angles.max()) if len(angles) else every[0].alpha3_range
    speeds = drawn_speeds(excitations)
    crossings = find_crossings(every, excitations, ends, speeds, limit)
    points = [(each.source, each.crank_angle, each.speed) for each in crossings]
    figure, sentences = draw_mechanism(every, excitations, limit, ends, points)
    title, rows, left = crossing_table(crossings, speeds, ends, every[0].unknown_factors)
    print(*sentences, crossing_text(title, rows, left), sep="\n")
    content = png_bytes(figure)
    if output.suffix.lower() == ".html":
        main = table_tag("crossings", rows[0], rows[1:]) if rows else ""
        main += f"<p>{escape(left)}</p>\n" + picture_tag(content, " ".join(sentences))
        content = plain_html(served[0].mechanism.name, [*sentences, title], main).encode()
    write_bytes(output, content, OutputError)
    print(f"Written: {output}")
    return 0
