# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The picture of a log shows the predictions in the log."""

import math
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.reading import BagError
from linkage_vibration.bags.writing import Topic, offered_qos_profiles
from linkage_vibration.drawing.plots import PlotError, _draw, _read, plot_predictions
from linkage_vibration.messages.definitions import message_definition, type_hash
from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.messages.topics import PREDICTION
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table
from test.support.drive import hitch_duty_cycle

PREDICTION_TOPIC = "/any_name/prediction"


def write_log(path: Path, times: list[float], alpha3: list[float]) -> Path:
    """Write the predictions for these angles as the node does."""
    predictor = Predictor(load_table(config_file("tables/three_point_linkage.npz")))
    topic = Topic(
        PREDICTION_TOPIC,
        PREDICTION,
        message_definition(PREDICTION),
        type_hash(PREDICTION),
        offered_qos_profiles(reliable=True, depth=10),
    )
    with LogWriter(path, [topic]) as log:
        for time, angle in zip(times, alpha3, strict=True):
            nanoseconds = round(time * 1e9)
            sec, nanosec = divmod(nanoseconds, 10**9)
            data = encode_message(PREDICTION, predictor.predict(angle), sec, nanosec, "")
            log.write(topic.name, data, nanoseconds, nanoseconds)
    return path


def drawn(log: Path) -> Figure:
    """Return the figure of a log."""
    figure = Figure(layout="constrained")
    _draw(figure, *_read(log))
    return figure


def legend(figure: Figure) -> list[str]:
    """Return the texts of a figure's legend."""
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_lines_are_the_predictions(tmp_path: Path) -> None:
    """Each row draws its quantity over seconds since the first stamp, in the unit of its label."""
    times, alpha3 = hitch_duty_cycle()
    log = write_log(tmp_path / "log.mcap", list(5 + times[::10]), list(alpha3[::10]))
    predictor = Predictor(load_table(config_file("tables/three_point_linkage.npz")))
    predictions = [predictor.predict(angle) for angle in alpha3[::10]]
    figure = drawn(log)
    rows = {ax.get_ylabel().replace("\n", " "): ax.get_lines() for ax in figure.axes}
    expected = {
        "crank angle $α_3$ [deg]": np.rad2deg(alpha3[::10]),
        "mode 3 $f_3$ [Hz]": [p.natural_frequencies[2] for p in predictions],
        "mode 2 $f_2$ [Hz]": [p.natural_frequencies[1] for p in predictions],
        "mode 1 $f_1$ [Hz]": [p.natural_frequencies[0] for p in predictions],
        "FRF peak [m/N]": [p.frf_peak_magnitude for p in predictions],
    }
    assert list(rows) == list(expected)
    for label, values in expected.items():
        np.testing.assert_allclose(rows[label][0].get_xdata(), times[::10], atol=1e-9)
        np.testing.assert_array_equal(rows[label][0].get_ydata(), values)
    peaks = [p.frf_peak_frequency for p in predictions]
    np.testing.assert_array_equal(rows["mode 1 $f_1$ [Hz]"][1].get_ydata(), peaks)
    assert figure.axes[-1].get_yscale() == "log"
    assert figure.axes[-1].get_xlabel() == "time [s]"
    assert legend(figure) == ["frequency of the FRF peak"]


def test_what_is_missing_or_invalid_shows(tmp_path: Path) -> None:
    """Lines break and the background is shaded where predictions are invalid or missing."""
    times = [0.01 * k for k in range(100)] + [3 + 0.01 * k for k in range(100)]
    alpha3 = [2.0] * 40 + [math.radians(190)] * 20 + [2.0] * 90 + [math.nan] + [2.0] * 49
    figure = drawn(write_log(tmp_path / "log.mcap", times, alpha3))
    assert legend(figure) == [
        "frequency of the FRF peak",
        "no prediction",
        "angle out of range or invalid (21 predictions)",
    ]
    for ax in figure.axes:
        paths = [path for shades in ax.collections for path in shades.get_paths()]
        corners = [np.asarray(path.vertices)[:, 0] for path in paths]
        spans = sorted((seconds.min(), seconds.max()) for seconds in corners)
        np.testing.assert_allclose(spans, [(0.40, 0.60), (0.99, 3.0), (3.50, 3.51)])
    frequencies = figure.axes[1].get_lines()[0].get_ydata()
    np.testing.assert_array_equal(
        np.flatnonzero(np.isnan(frequencies)),
        [*range(40, 60), 100, 151],  # index 100 is the break between two predictions
    )


def test_legend_is_below_the_rows(tmp_path: Path) -> None:
    """The legend covers no row, no label of its axis, and nothing outside the picture."""
    times, alpha3 = hitch_duty_cycle()
    figure = drawn(write_log(tmp_path / "log.mcap", list(times[::10]), list(alpha3[::10])))
    figure.draw_without_rendering()
    legend = figure.legends[0].get_window_extent()
    boxes = [ax.get_tightbbox() for ax in figure.axes]
    lowest = min(box.y0 for box in boxes if box is not None)
    assert 0.0 <= legend.y0 < legend.y1 <= lowest


@pytest.mark.parametrize("count", [1, 2, 500])
def test_picture_is_a_png(tmp_path: Path, count: int) -> None:
    """A PNG of the documented size is written, even for a single prediction, and nothing else."""
    log = write_log(tmp_path / "log.mcap", [0.01 * k for k in range(count)], [2.0] * count)
    plot_predictions(log, tmp_path / "log.png")
    content = (tmp_path / "log.png").read_bytes()
    assert content[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", content[16:24]) == (1500, 1290)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.mcap", "log.png"]


def test_errors_name_the_place_and_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A missing prediction, log, folder or matplotlib is reported."""
    empty = write_log(tmp_path / "empty.mcap", [], [])
    with pytest.raises(PlotError, match=r"empty\.mcap holds no prediction"):
        plot_predictions(empty, tmp_path / "a.png")
    with pytest.raises(BagError, match="There is no bag"):
        plot_predictions(tmp_path / "none.mcap", tmp_path / "a.png")
    log = write_log(tmp_path / "log.mcap", [0.0, 0.01], [2.0, 2.1])
    with pytest.raises(PlotError, match=r"a\.png: cannot be written"):
        plot_predictions(log, tmp_path / "nowhere" / "a.png")
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(PlotError, match=r"pip install linkage_vibration\[plots\]"):
        plot_predictions(log, tmp_path / "a.png")
