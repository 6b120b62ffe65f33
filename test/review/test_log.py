# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A log is read as it was written."""

import csv
import importlib.util
import io
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.messages.fields import message_fields
from linkage_vibration.messages.topics import ASSESSED, PREDICTION, log_topic
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.prediction.verdict import worst_message
from linkage_vibration.review import log as log_module
from linkage_vibration.review.findings import first_sentence
from linkage_vibration.review.listening_page import answers
from linkage_vibration.review.log import (
    PLACE,
    ReviewError,
    _read_model,
    _together,
    csv_text,
    gaps,
    read_log,
)
from linkage_vibration.review.overview import drive_summary
from linkage_vibration.support.resources import PAPER_MECHANISM, PAPER_TABLE, config_file
from linkage_vibration.table.table import load_table
from test.support.messages import read_messages


def test_every_number_is_the_message_s(drive: Path) -> None:
    """Predictions and resonances are exactly those that rosbags decodes one by one."""
    log = read_log(drive)
    messages = [message for _, message in read_messages(drive, "/linkage_vibration/prediction")]
    for name, shown in (
        ("crank_angle", log.crank_angle),
        ("status", log.status),
        ("natural_frequencies", log.natural_frequencies),
        ("frequency_stddevs", log.frequency_stddevs),
        ("damping_ratios", log.damping_ratios),
        ("frf_peak_frequency", log.peak_frequency),
        ("frf_peak_magnitude", log.peak_magnitude),
        ("interpolation_error", log.interpolation_error),
    ):
        np.testing.assert_array_equal(shown, [getattr(m, name) for m in messages], name)
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages]
    np.testing.assert_array_equal(log.stamps, stamps)
    assert log.resonances is not None
    for topic, names in (
        ("resonance", ("excitation", "excitation_frequency", "mode", "approach_rate")),
        ("levels", ("total_velocity", "total_load_place")),
        ("load_state", ("state", "unknown_sources", "excitation_index", "quiet_speed")),
    ):
        others = [message for _, message in read_messages(drive, f"/linkage_vibration/{topic}")]
        for name in names:
            expected = [getattr(m, name) for m in others]
            np.testing.assert_array_equal(getattr(log.resonances, name), expected, name)


def test_resonances_are_the_message_s_fields(drive: Path) -> None:
    """Every number of the messages is a column, except headers and tables, and what follows."""
    fields = [field for kind in ASSESSED for field in message_fields(kind)]
    names = [field.name for field in fields if not field.is_sequence]
    expected = {name for name in names if not name.startswith("header.")} - {"table_id"}
    expected |= {"margin", "relative_margin", "approach", "time_to_crossing"}
    expected |= {"load_ratio", "load_ratio_factor"}
    assert set(vars(read_log(drive).resonances)) == expected


def test_provenance_is_found(drive: Path) -> None:
    """Table, mechanism, excitations, parameters and speeds are read from the log."""
    log = read_log(drive)
    table = load_table(config_file(PAPER_TABLE))
    assert log.table is not None
    assert log.table.table_id == table.table_id == log.table_id
    assert len(bytes.fromhex(log.table_id)) == 8
    assert log.mechanism is not None
    assert log.mechanism.model_hash == table.model_hash
    assert log.mechanism_text == config_file(PAPER_MECHANISM).read_text()
    assert [e.name for e in log.excitations][:2] == ["engine 0.5", "engine 1"]
    limits = {"warning_load_ratio": 0.02, "note_load_ratio": 0.005, "warning_dwell": 0.2}
    assert log.parameters == {"angle_stddev": 0.005, **limits}
    times, engine = log.speeds[Source.ENGINE]
    np.testing.assert_allclose(times, 0.1 * np.arange(200), atol=1e-9)
    assert set(log.speeds) == {Source.ENGINE, Source.PTO}
    assert engine[0] > 1900.0


def test_gap(drive: Path) -> None:
    """The second without predictions is a gap."""
    assert gaps(read_log(drive)) == [(5.0, 6.0)]


def test_csv_gives_the_same_floats_again(drive: Path, tmp_path: Path) -> None:
    """Each number in the CSV file is read as the same float as in the log."""
    log = read_log(drive)
    rows = list(csv.DictReader(io.StringIO(csv_text(log))))
    assert [int(row["stamp_ns"]) for row in rows] == log.stamps.tolist()
    for name, values in (
        ("crank_angle_rad", log.crank_angle),
        ("natural_frequency_2_hz", log.natural_frequencies[:, 1]),
        ("frf_peak_magnitude_m_per_n", log.peak_magnitude),
    ):
        np.testing.assert_array_equal([float(row[name]) for row in rows], values)
    assert log.resonances is not None
    assert [row["excitation"] for row in rows] == log.resonances.excitation.tolist()


def test_datasets_of_logs(drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A dataset has the log's numbers over time and mode with units; without xarray it is named."""
    pytest.importorskip("xarray", reason="xarray is not installed")
    log = read_log(drive)
    data = log.to_xarray()
    assert data.sizes == {"time": len(log.stamps), "mode": log.n_modes}
    np.testing.assert_array_equal(
        data.natural_frequencies.sel(mode=2), log.natural_frequencies[:, 1]
    )
    np.testing.assert_array_equal(data.frf_peak_magnitude, log.peak_magnitude)
    np.testing.assert_array_equal(data.time.astype(np.int64), log.stamps)
    np.testing.assert_array_equal(data.crank_angle, log.crank_angle)
    actual = {name: data[name].attrs.get("units") for name in ("damping_ratios", "status")}
    assert actual == {"damping_ratios": "1", "status": None}
    assert log.drive is not None
    every = log.drive.resonances.to_xarray()
    assert every.load_ratios.dims == ("row", "load_ratios_index")
    assert "mode" not in every.dims
    assert every.excitation_frequency.attrs == {"units": "Hz"}
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(LinkageVibrationError, match=r"`pip install linkage_vibration\[xarray\]`"):
        log.to_xarray()


def test_table_of_pandas(drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The rows of pandas are those of the CSV file, at the stamps; without pandas it is named."""
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    log = read_log(drive)
    frame, table = log.to_pandas(), pandas.read_csv(io.StringIO(csv_text(log)))
    assert frame.index.name == "time"
    assert frame.index.as_unit("ns").asi8.tolist() == table.pop("stamp_ns").tolist()
    numbers = frame.select_dtypes("number")
    assert list(frame.columns) == list(table.columns)
    np.testing.assert_allclose(numbers, table[numbers.columns], rtol=1e-12)
    assert frame.excitation.tolist() == table.excitation.fillna("").tolist()
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(LinkageVibrationError, match=r"`pip install linkage_vibration\[xarray\]`"):
        log.to_pandas()


@pytest.mark.parametrize("unknown", [False, True])
def test_deviations_that_are_not_known_have_a_reason(drive: Path, unknown: bool) -> None:
    """CSV, dataset, JSON and the answers of `listen` have the table's reason beside NaN alone."""
    log = read_log(drive)
    assert log.table is not None
    names = "frequency_stddevs", "damping_ratio_stddevs"
    changed = {name: getattr(log, name).copy() for name in names}
    why = "Standard deviations are not known where modes veer too quickly"
    spread = np.full((2, 9, log.n_modes), 0.01)
    if unknown:
        spread[0, 3, 1] = math.nan
        for values in changed.values():
            values[7, 1] = math.nan
    log = replace(log, **changed, table=replace(log.table, parameter_stddev=spread))
    rows = list(csv.DictReader(io.StringIO(csv_text(log))))
    reasons = [i for i, row in enumerate(rows) if row.get("unknown_deviations", "").startswith(why)]
    assert reasons == [7] * unknown
    assert drive_summary(log)["model"]["unknown_deviations"].startswith(why) == unknown
    assert answers(log, [], ())[-1].startswith(why) == unknown
    if importlib.util.find_spec("xarray"):
        assert log.to_xarray().attrs["unknown_deviations"].startswith(why) == unknown


@pytest.mark.parametrize("unknown", [False, True])
def test_factors_that_are_not_known_have_a_reason(drive: Path, unknown: bool) -> None:
    """CSV, JSON and the sentence of a drive have a reason beside the NaN of a known load alone."""
    log = read_log(drive)
    assert log.drive is not None
    assert log.resonances is not None
    row = worst_message(log.drive)
    at = int(log.drive.predictions[row])
    for columns, i in ((log.drive.resonances, row), (log.resonances, at)):
        factors = np.full(columns.load_ratio.shape, 1.1, np.float32)
        columns.load_ratio_factor, columns.total_load_ratio_factor = factors, factors.copy()
        columns.total_load_ratio_factor[i] = math.nan if unknown else 1.1
    why, lost = "no number of the mechanism is uncertain", set[int]()
    rows = list(csv.DictReader(io.StringIO(csv_text(log))))
    for i, values in enumerate(rows):
        for name in ("load_ratio", "total_load_ratio"):
            if values[name] != "nan" and values[f"{name}_factor"] == "nan":
                lost.add(i)
    assert {i for i, values in enumerate(rows) if values["unknown_factors"].startswith(why)} == lost
    assert (at in lost) == unknown
    worst = drive_summary(log)["worst"]
    assert (worst["load_ratio_factor"] is None) == unknown
    assert worst["unknown_factor"].startswith(why) == unknown
    assert (f"(standard deviation not known, as {why}" in first_sentence(log)) == unknown


def test_why_a_table_has_no_factors(drive: Path) -> None:
    """Without uncertain numbers, or without an ensemble of models, the reason is another one."""
    table = read_log(drive).table
    assert table is not None
    assert table.unknown_factors == "no number of the mechanism is uncertain"
    table = replace(table, parameter_stddev=np.full((2, 9, table.n_modes), 0.01))
    assert table.unknown_factors.startswith("models with other numbers cannot be interpolated")
    table = replace(table, ensemble_alpha3=np.ones(2))
    assert table.unknown_factors.startswith("fewer than 95 % of the models with other numbers had")


def test_bare_log(write_log: Any, tmp_path: Path) -> None:
    """A log without speeds and attachments is read; what it lacks is None or empty."""
    log = read_log(write_log(tmp_path / "bare.mcap", [0.0, 0.1], [2.0, math.nan], False, False))
    assert log.resonances is None
    assert log.table is None
    assert log.mechanism is None
    assert log.excitations == ()
    assert log.speeds == {}
    assert log.parameters == {}
    assert log.status.tolist() == [0, 2]


def test_no_prediction(write_log: Any, tmp_path: Path) -> None:
    """A log without a prediction is refused."""
    with pytest.raises(ReviewError, match=r"empty\.mcap holds no prediction"):
        read_log(write_log(tmp_path / "empty.mcap", [], []))


def test_latest_resonance_of_each_prediction(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between resonances, whose rate is limited, a prediction has the last one before it, if any.

    A recorder missed the first one.
    """
    monkeypatch.setattr(
        log_module, "_together", lambda columns: {n: c[1:] for n, c in _together(columns).items()}
    )
    log = tmp_path / "log.mcap"
    replay(config_file("drives/hitch_duty_cycle.mcap"), log, Parameters(resonance_rate=5.0))
    times = [
        np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in messages])
        for messages in (
            list(read_messages(log, f"/linkage_vibration/{topic}"))
            for topic in ("prediction", "resonance")
        )
    ]
    assert 15 * len(times[1]) < len(times[0])  # 5 of 100 Hz
    messages = read_messages(log, "/linkage_vibration/resonance")
    margins = [m.excitation_frequency - m.natural_frequency for _, m in messages][1:]
    expected = []
    for stamp in times[0].tolist():
        earlier = [k for k, time in enumerate(times[1][1:].tolist()) if time <= stamp]
        expected.append(margins[earlier[-1]] if earlier else math.nan)
    actual = read_log(log).resonances
    assert actual is not None
    np.testing.assert_array_equal(actual.margin, expected)
    unknown = np.isnan(expected)
    assert (actual.state[unknown] == 0).all()
    assert (unknown.any(), set(actual.mode[unknown])) == (True, {-1})


def test_assessments_of_which_a_message_is_missing() -> None:
    """Where a recorder missed one of three messages of a topic, the others stay beside theirs."""
    assessed = []
    for name, stamps in {"first": [1, 3], "second": [1, 2, 3]}.items():
        stamp = {"header.stamp.sec": np.array(stamps), "header.stamp.nanosec": np.array(stamps)}
        assessed.append({**stamp, PLACE: np.array(stamps), name: 10 * np.array(stamps)})
    together = _together(assessed)
    assert together["first"].tolist() == together["second"].tolist() == [10, 30]


def test_a_log_of_an_earlier_version(tmp_path: Path) -> None:
    """The error names the field that the messages of such a log lack, and what helps."""
    topic = log_topic("/p", PREDICTION)
    named = topic.definition.replace(" frequency_stddevs ", " frequency_stddev ")
    assert named != topic.definition
    predictor = Predictor(load_table(config_file(PAPER_TABLE)))
    data = encode_message(PREDICTION, predictor.predict(2.0), 1, 0, "")
    with LogWriter(tmp_path / "old.mcap", [replace(topic, definition=named)]) as log:
        log.write("/p", data, 10**9, 10**9)
    match = r"old\.mcap was written by another .* VibrationPrediction has no frequency_stddevs; rep"
    with pytest.raises(ReviewError, match=match):
        read_log(tmp_path / "old.mcap")


def test_attachments_that_cannot_be_unpacked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Names that no file can have are skipped; a full disk of temporary files is named."""
    names = ["", ".", "..", "a/..", "/", "a\0.yaml", "x" * 300]
    assert _read_model(dict.fromkeys(names, b"x"), "") == (None, None, "", ())

    def full(path: Path, data: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(
        ReviewError, match=r"unpacked into .* \(No space left on device\); .*TMPDIR"
    ):
        _read_model({"a.yaml": b"x"}, "")
