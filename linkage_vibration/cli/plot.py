# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draw a mechanism over its stroke: modes, orders, and the load ratio over height and speed."""

import argparse
from pathlib import Path

from linkage_vibration.cli.arguments import SHIPPED, read_levels, read_settings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    add("mechanism", nargs="?", type=Path, help=SHIPPED)
    add("--table", type=Path, help="table to use (default: the shipped one, or a new one)")
    add("--excitations", type=Path, help="YAML file (default: the shipped excitations)")
    text = "PNG picture or HTML page to write (default: MECHANISM with .png, in this folder)"
    add("-o", "--output", type=Path, help=text)


def run(options: argparse.Namespace) -> int:
    """Draw the picture or the page, and print where loads are largest; return the exit code."""
    from linkage_vibration.drawing.mechanism_picture import draw_mechanism
    from linkage_vibration.drawing.plots import png_bytes, require_matplotlib
    from linkage_vibration.review.html import picture_tag, plain_html
    from linkage_vibration.support.atomic_files import OutputError, check_outputs, write_bytes

    files = options.mechanism, options.table, options.excitations
    settings = read_settings(options, table_file=options.table, excitation_file=options.excitations)
    output = options.output or Path(settings.mechanism_path().with_suffix(".png").name)
    check_outputs([output], list(filter(None, files)))
    if output.suffix.lower() not in (".png", ".html"):
        raise OutputError(f"{output}: a plot is a .png or an .html file; use one of these endings.")
    require_matplotlib()
    served, excitations, levels = read_levels(settings)
    limit = settings.warning_limits().warning
    figure, sentences = draw_mechanism(served.predictor, levels, excitations, limit)
    print("\n".join(sentences))
    content = png_bytes(figure)
    if output.suffix.lower() == ".html":
        picture = picture_tag(content, " ".join(sentences))
        content = plain_html(served.mechanism.name, sentences, picture).encode()
    write_bytes(output, content, OutputError)
    print(f"Written: {output}")
    return 0
