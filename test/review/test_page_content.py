# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the page of a log holds: its charts, readings, tables and texts, beside the messages."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linkage_vibration.drawing import palette
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.review.log import Log, read_log
from linkage_vibration.review.review_page import (
    _load_levels,
    _span,
    as_precise,
    clock,
    provenance_rows,
    review_page,
)
from linkage_vibration.support.resources import PAPER_MECHANISM, config_file
from test.support.messages import read_messages

LEVELS, STATE = "/linkage_vibration/levels", "/linkage_vibration/load_state"
PREDICTION = "/linkage_vibration/prediction"


@pytest.fixture(scope="module")
def log(drive: Path) -> Log:
    """Return a log with a gap from 5 to 6 s, NaN at 3 s and angles beyond the table at 12 s."""
    return read_log(drive)


@pytest.fixture(scope="module")
def content(log: Log) -> dict[str, Any]:
    """Return what its page holds."""
    return dict(review_page(log).content)


def test_columns_are_those_of_the_messages(log: Log, drive: Path) -> None:
    """Each prediction has its angle, frequencies, deviations and the latest load ratio."""
    columns = review_page(log).columns
    messages = [message for _, message in read_messages(drive, PREDICTION)]
    assert len(columns["time"]) == len(messages)
    for name, numbers in {
        "crank_angle": [m.crank_angle for m in messages],
        "peak_frequency": [m.frf_peak_frequency for m in messages],
        "peak_magnitude": [m.frf_peak_magnitude for m in messages],
        "f3": [m.natural_frequencies[2] for m in messages],
        "s1": [m.frequency_stddevs[0] for m in messages],
        "status": [m.status for m in messages],
    }.items():
        np.testing.assert_array_equal(columns[name], np.asarray(numbers, columns[name].dtype))
    levels = {stamp: m.total_load_ratio for stamp, m in read_messages(drive, LEVELS)}
    states = {stamp: m.state for stamp, m in read_messages(drive, STATE)}
    stamps = [stamp for stamp, _ in read_messages(drive, PREDICTION)]
    for row, stamp in enumerate(stamps):
        if stamp in levels:
            latest = levels[stamp], states[stamp]
            np.testing.assert_equal(columns["load_ratio"][row], np.float32(latest[0]))
            assert columns["state"][row] == latest[1]
    part = columns["load_of"].astype(bool)
    assert np.isnan(columns["load_known"][part]).all()
    assert np.isnan(columns["load_part"][~part]).all()
    shown = np.where(part, columns["load_part"], columns["load_known"])
    np.testing.assert_array_equal(shown, columns["load_ratio"])


def test_charts_and_their_keys(log: Log, content: dict[str, Any]) -> None:
    """The load is drawn with its limit, each mode in its colour, and the key names what is there.

    What is not there, such as a toggle in this drive, has no entry.
    """
    load, modes, angle = content["charts"]
    assert (load["id"], load["limit"], load["unit"]) == ("load", 0.02, "1")
    assert [line["column"] for line in modes["series"]] == ["f1", "f2", "f3"]
    assert [line["colour"] for line in modes["series"]] == palette.mode_colours(3)
    assert [line["spread"] for line in modes["series"]] == ["s1", "s2", "s3"]
    assert not any("style" in line for line in modes["series"])  # the paper's is in a plane
    assert modes["title"] == "Natural frequencies, with 2 standard deviations, and orders"
    assert angle["series"][0]["factor"] == pytest.approx(math.degrees(1.0))
    key = {each["label"]: each for each in load["key"]}
    assert key["no prediction"]["colour"] == palette.GAP_SHADE
    assert key["angle invalid"]["colour"] == palette.INVALID_SHADE
    assert "near a toggle" not in key
    assert [chart.get("first", False) for chart in content["charts"]] == [True, False, False]
    quiet = replace(log, frequency_stddevs=0.0 * log.frequency_stddevs)
    assert "spread" not in review_page(quiet).content["charts"][1]["series"][0]
    whole = replace(log, status=np.zeros_like(log.status))
    labels = [each["label"] for each in review_page(whole).content["charts"][0]["key"]]
    assert "angle invalid" not in labels
    assert "no prediction" in labels


def test_shades_are_where_something_is_missing(content: dict[str, Any]) -> None:
    """They are the gap, the invalid angle, of one prediction, and the angles beyond the table."""
    spans = [[round(each[0], 6), round(each[1], 6), each[2]] for each in content["shades"]]
    assert spans == [[5.0, 6.0, "gap"], [3.0, 3.01, "range"], [12.0, 12.5, "range"]]


def test_key_of_the_modes(log: Log) -> None:
    """Words for orders appear where their loads are above the limit, weak or not known."""
    assert log.drive is not None
    words = "order, as wide as its load", "order, above the limit", "order, weak"
    unknown = "order, load not known"
    count = len(log.drive.times)
    cases = [(0.021, {words[0], words[1]}), (0.02, {words[0]}), (3.9e-4, {words[2]})]
    for ratio, expected in [*cases, (math.nan, {unknown})]:
        loads = np.full((count, 6), ratio)
        columns = vars(log.drive.resonances) | {"load_ratios": loads}
        drive = replace(log.drive, resonances=MessageColumns(**columns))
        key = review_page(replace(log, drive=drive)).content["charts"][1]["key"]
        assert {each["label"] for each in key} == expected


def test_excitations_and_speeds(content: dict[str, Any], drive: Path) -> None:
    """Each order has the ratio of Hz to rpm, and each speed its messages."""
    ratios = {each["name"]: each["ratio"] for each in content["excitations"]}
    orders = {"engine 0.5": 0.5, "engine 1": 1.0, "engine 3": 3.0, "engine_shake 1.5": 1.5}
    orders |= {"pto_shaft 1": 1.0, "pto_shaft 2": 2.0}
    assert ratios == pytest.approx({name: order / 60.0 for name, order in orders.items()})
    for source in ("engine", "pto"):
        values = [m.data for _, m in read_messages(drive, f"/{source}_speed")]
        np.testing.assert_allclose(content["speeds"][source]["values"], values, rtol=1e-6)
    assert [each["load"] for each in content["excitations"]] == [f"w{i}" for i in range(6)]


def test_tables_of_loads(log: Log, content: dict[str, Any], drive: Path) -> None:
    """Of each source the largest load ratio of all messages is listed, the largest first."""
    tables = {table["id"]: table for table in content["tables"]}
    messages = [message for _, message in read_messages(drive, LEVELS)]
    maxima = np.fmax.reduce([m.load_ratios for m in messages])
    largest = dict(zip((each["name"] for each in content["excitations"]), maxima, strict=True))
    rows = {row["cells"][0]: row["cells"] for row in tables["contributions"]["rows"]}
    assert set(rows) == set(largest)
    for name, ratio in largest.items():
        if math.isnan(ratio):
            assert rows[name][1:3] == ["not known", ""]
        else:
            assert float(rows[name][1]) == pytest.approx(ratio, rel=0.06)
    known = sorted((v for v in largest.values() if v > 0.0), reverse=True)[:3]
    shown = [float(row["cells"][1]) for row in tables["sources"]["rows"]]
    assert shown == pytest.approx(known, rel=0.06)
    assert tables["sources"]["title"] == "The largest sources that are known"
    count = len(tables["moments"]["rows"])
    assert tables["moments"]["title"] == f"Warnings ({count})"
    lengths = [row["length"] for row in tables["moments"]["rows"]]
    assert [f"{length:.1f}" for length in lengths] == [
        row["cells"][-1] for row in tables["moments"]["rows"]
    ]


def test_summary_of_a_drive(content: dict[str, Any], log: Log) -> None:
    """Duration, numbers of predictions and gaps, and the mechanism are below the charts."""
    rows = dict(content["provenance"]["rows"])
    assert rows["Drive"] == "20.0 s, 1,901 predictions"
    assert rows["Predictions not OK"] == "51"
    assert rows["Gaps"] == "1, 1.0 s in total"
    assert rows["Range of angles"] == "90 to 180 deg"
    assert rows["This page holds"].startswith("all 1,901 predictions; times and angles are exact")
    mechanism = config_file(PAPER_MECHANISM).read_text()
    files = {each["name"]: each["text"] for each in content["provenance"]["files"]}
    assert files["Mechanism"] == mechanism
    assert "angle_stddev: 0.005" in files["Parameters"]
    errors = dict(provenance_rows(log))["Relative error of the table"]
    assert log.table is not None
    assert errors.startswith(
        f"natural frequencies and damping ratios {log.table.interpolation_error.max():.1e}, FRF "
    )


def test_overdamped_modes_are_counted(log: Log) -> None:
    """The summary says in how many predictions a mode has no frequency though others have."""
    frequencies = log.natural_frequencies.copy()
    frequencies[10:14, 1] = math.nan
    changed = replace(log, natural_frequencies=frequencies)
    rows = dict(review_page(changed).content["provenance"]["rows"])
    name = log.mode_label(1)
    assert rows[name[0].upper() + name[1:]] == "overdamped in 4 predictions"


@pytest.mark.parametrize(
    ("time", "whole", "text"),
    [
        (3.456, 119.0, "3.46"),
        (3.456, 120.0, "0:03.5"),
        (125.04, 3599.0, "2:05.0"),
        (125.04, 3600.0, "0:02:05.0"),
        (7384.96, 9000.0, "2:03:05.0"),
    ],
)
def test_times_as_on_a_clock(time: float, whole: float, text: str) -> None:
    """Times are seconds below two minutes of a drive, and have hours from one hour on."""
    assert clock(time, whole) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(119.9, "119.9 s"), (120.0, "2.0 min"), (3599.0, "60.0 min"), (5400.0, "1.50 h")],
)
def test_durations_in_words(seconds: float, text: str) -> None:
    """Durations are in s, min or h."""
    assert _span(seconds) == text


@pytest.mark.parametrize(
    ("ratio", "factor", "text"),
    [
        (0.0886, math.nan, "0.089"),
        (0.0886, 1.01, "0.089"),
        (0.0886, 1.2, "0.09"),
        (0.0886, 2.55, "0.09"),
        (1.234, 1.5, "1.2"),
        (1.234, 2.5, "1"),
        (207.0, math.nan, "210"),
        (0.0, math.nan, "0"),
        (math.nan, math.nan, "not known"),
    ],
)
def test_load_ratio_has_no_digits_below_its_deviation(
    ratio: float, factor: float, text: str
) -> None:
    """A load ratio has two digits, or fewer if its deviation, ratio (factor - 1), is larger."""
    assert as_precise(ratio, factor) == text


def test_steps_of_loads() -> None:
    """Steps tell unknown, weak, and loads on both sides of the limit apart."""
    limit = 0.33
    ratios = [math.nan, 0.0, 0.0065, 0.0067, limit, np.nextafter(limit, 1.0), 0.66, 9.0]
    steps = _load_levels(np.array(ratios), limit).tolist()
    assert steps[:3] == [0, 1, 1]
    assert 2 <= steps[3] < steps[4] == 128 < steps[5] < steps[6] == steps[7] == 255
