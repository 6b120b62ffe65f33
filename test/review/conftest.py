# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A log of a drive with every kind of fault, and a headless Chromium that shows its page."""

import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
import yaml

from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.writing import Attachment, Topic, offered_qos_profiles
from linkage_vibration.messages.definitions import message_definition, type_hash
from linkage_vibration.messages.encoding import encode_columns
from linkage_vibration.prediction.excitation import Source, excitations_from_mapping
from linkage_vibration.prediction.levels import kept_levels
from linkage_vibration.prediction.predictor import Predictor, predict_many
from linkage_vibration.prediction.resonance import ReportedSpeed, ResonanceMonitor
from linkage_vibration.prediction.severity import WarningLimits
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import PAPER_MECHANISM, PAPER_TABLE, config_file
from linkage_vibration.table.table import load_table, table_bytes
from test.support.browser import Browser
from test.support.drive import engine_and_pto_speed, hitch_duty_cycle

START = 1_767_225_600 * 10**9  # ns
TOPICS = {
    "/linkage_vibration/prediction": "linkage_vibration_interfaces/msg/VibrationPrediction",
    "/linkage_vibration/resonance": "linkage_vibration_interfaces/msg/Resonance",
    "/linkage_vibration/levels": "linkage_vibration_interfaces/msg/Levels",
    "/linkage_vibration/load_state": "linkage_vibration_interfaces/msg/LoadState",
    "/engine_speed": "std_msgs/msg/Float64",
    "/pto_speed": "std_msgs/msg/Float64",
}
LIMITS = WarningLimits(warning=0.02, note=0.005, dwell=0.2)
PARAMETERS = b"""linkage_vibration:
  ros__parameters:
    angle_stddev: 0.005
    warning_load_ratio: 0.02
    note_load_ratio: 0.005
    warning_dwell: 0.2
"""
EXCITATIONS = b"""
engine: {speed: engine, orders: [0.5, 1, 3]}
engine_shake: {speed: engine, orders: [1.5], force: [100.0], at: E1.z, at_speed: 2000.0}
pto_shaft: {speed: pto, orders: [1, 2], force: [60.0, 60.0], at: E1.z, at_speed: 540.0}
"""
WriteLog = Callable[..., Path]


@pytest.fixture(scope="session")
def write_log() -> WriteLog:
    """Return a function that writes predictions, resonances and speeds (10 Hz) as the node does."""
    table = load_table(config_file(PAPER_TABLE))
    predictor = Predictor(table)
    excitations = excitations_from_mapping(yaml.safe_load(EXCITATIONS))
    levels = kept_levels(predictor, read_mechanism(config_file(PAPER_MECHANISM)), excitations)

    def write(
        path: Path,
        times: Sequence[float],
        alpha3: Sequence[float],
        speeds: bool = True,
        provenance: bool = True,
    ) -> Path:
        monitor = ResonanceMonitor(excitations, LIMITS, levels=levels)
        qos = offered_qos_profiles()
        topics = [
            Topic(name, kind, message_definition(kind), type_hash(kind), qos)
            for name, kind in TOPICS.items()
            if speeds or "prediction" in name
        ]
        files = {
            PAPER_MECHANISM: config_file(PAPER_MECHANISM).read_bytes(),
            f"{table.table_id}.npz": table_bytes(table),
            "excitations.yaml": EXCITATIONS,
            "parameters.yaml": PARAMETERS,
        }
        attachments = [Attachment(name, "application/yaml", data) for name, data in files.items()]
        stamps = [START + round(1e9 * time) for time in times]
        reports, written = list[ReportedSpeed](), list[tuple[int, str, int, bytes]]()
        for at, *values in zip(*engine_and_pto_speed(), strict=True) if speeds else ():
            before = next((row for row, time in enumerate(times) if at <= time), None)
            for source, speed in zip((Source.ENGINE, Source.PTO), values, strict=True):
                if before is not None:
                    received = START + round(1e9 * at)
                    reports.append(ReportedSpeed(before, source, float(speed), received))
                    data = b"\0\1\0\0" + struct.pack("<d", speed)
                    written.append((2 * before, f"/{source.value}_speed", received, data))
        deviations = np.full(len(stamps), 0.005)
        columns = [predict_many(predictor, np.asarray(alpha3, float), deviations)]
        if speeds:
            unknown = np.full(len(stamps), np.nan)
            given = unknown, np.array(stamps), reports, 0.0 * deviations
            columns += 3 * [monitor.assess_many(columns[0], *given)]
        sec, nanosec = np.divmod(stamps, 10**9)
        for (name, kind), answers in zip(TOPICS.items(), columns, strict=False):
            for rows, encoded in encode_columns(kind, answers, sec, nanosec, ""):
                for row, data in zip(rows.tolist(), encoded, strict=True):
                    written.append((2 * row + 1, name, stamps[row], data.tobytes()))
        written.sort(key=lambda each: each[0])
        path.unlink(missing_ok=True)
        with LogWriter(path, topics, attachments if provenance else ()) as log:
            for _, name, time, data in written:
                log.write(name, data, time, time)
        return path

    return write


@pytest.fixture(scope="session")
def drive(write_log: WriteLog, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a log of 20 s with a gap (5 to 6 s), NaN (3 s) and invalid angles (12 to 12.5 s)."""
    times, alpha3 = hitch_duty_cycle()
    alpha3[(times >= 12.0) & (times < 12.5)] = np.deg2rad(185.0)
    alpha3[300] = np.nan
    there = (times <= 5.0) | (times >= 6.0)
    path = tmp_path_factory.mktemp("drive") / "drive.mcap"
    return write_log(path, times[there], alpha3[there])


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Return the browser of the tests of a file; a page that moves would slow other files down."""
    with Browser() as actual:
        yield actual
