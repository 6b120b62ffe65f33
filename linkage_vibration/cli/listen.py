# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Write a page with the measured vibration of a drive beside the predicted one.

The log holds the predictions of the drive; the file of sensors says what measured it, and where.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from linkage_vibration.cli.arguments import add_mechanism, mechanism_file

if TYPE_CHECKING:
    from linkage_vibration.readers.sensors import Sensor


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    add("log", type=Path, metavar="LOG", help="MCAP file of predictions, of the node or a replay")
    add("--sensors", type=Path, required=True, metavar="FILE", help="YAML file of sensors")
    add("-o", "--output", type=Path, help="HTML file to write (default: LOG with _listen.html)")
    text = "also write the excitations with measured amplitudes and deviations to this file"
    add("--amplitudes", type=Path, metavar="FILE", help=text)
    text = "also write natural frequencies without doubts as targets of `calibrate` to this file"
    add("--targets", type=Path, metavar="FILE", help=text)
    add_mechanism(parser)


def run(options: argparse.Namespace) -> int:
    """Write the page and other files, and print the answer; return the exit code."""
    import numpy as np
    from tqdm import tqdm

    from linkage_vibration.errors import LinkageVibrationError
    from linkage_vibration.listening.amplitudes import amplitude_numbers
    from linkage_vibration.listening.model_check import drive_targets
    from linkage_vibration.listening.signals import measured_signal
    from linkage_vibration.readers.mechanism import read_mechanism
    from linkage_vibration.readers.sensors import read_measured
    from linkage_vibration.review import listening_page as page
    from linkage_vibration.review.log import ReviewError, read_log
    from linkage_vibration.studies.yaml_editing import edit_text
    from linkage_vibration.support.atomic_files import write_files
    from linkage_vibration.support.strict_yaml import load_yaml_text

    output = options.output or options.log.with_name(f"{options.log.stem}_listen.html")
    outputs = [output, *(path for path in (options.amplitudes, options.targets) if path)]
    mechanism = mechanism_file(options)
    sensors = _sensors(options, outputs, mechanism)
    log = read_log(options.log)
    given = read_mechanism(mechanism).model_hash if options.targets else ""
    if log.mechanism and given not in ("", log.mechanism.model_hash):
        text = f"the log has another mechanism than {mechanism}; give its file with --mechanism"
        raise ReviewError(f"{options.log}: {text}.")
    highest = float(np.fmax.reduce(log.natural_frequencies.ravel(), initial=0.0))
    comparisons = []
    with tqdm(disable=None, total=len(sensors) + 2, unit=" steps", delay=2.0) as bar:
        for sensor in sensors:
            times, readings = read_measured(sensor, options.log, int(log.stamps[0]))
            signal = measured_signal(sensor, times, readings, highest)
            comparisons.append(page.compare_sensor(log, signal))
            bar.update()
        modes = page.heard_modes(log, comparisons)
        bar.update()
        content = {output: [page.listening_page(log, comparisons, modes).encode()]}
        bar.update()
    if options.amplitudes:
        rows = [row for each in comparisons for row in each.rows]
        # Without rows, the excitations of an older log may be refused by this version.
        numbers = amplitude_numbers(rows, load_yaml_text(log.excitations_text)) if rows else []
        text = edit_text(log.excitations_text, numbers, ReviewError)
        content[options.amplitudes] = [text.encode()]
    refusal = None  # The page says why no mode is a target.
    if options.targets:
        assert log.table is not None
        try:
            text = drive_targets(modes, log.table, mechanism, options.targets)
            content[options.targets] = [text.encode()]
        except LinkageVibrationError as error:
            refusal = error
    write_files(content, ReviewError)
    print("\n".join(page.answers(log, comparisons, modes)))
    print(f"Written: {', '.join(map(str, content))}")
    if refusal:
        raise refusal
    return 0


def _sensors(
    options: argparse.Namespace, outputs: Sequence[Path], mechanism: Path
) -> "list[Sensor]":
    """Return the sensors; refuse outputs, of which the first is the page, that cannot be."""
    from linkage_vibration.readers.sensors import read_sensors
    from linkage_vibration.support.atomic_files import check_outputs, check_suffix

    for path in outputs:
        check_suffix(path, ".html" if path is outputs[0] else ".yaml")
    check_outputs(outputs, [options.log, options.sensors, mechanism])
    sensors = read_sensors(options.sensors)
    check_outputs(outputs, [sensor.file for sensor in sensors if sensor.file])
    return sensors
