# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The picture of a log shows the modes, the excitations and the load ratio in the log."""

import math
import struct
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from linkage_vibration.drawing.plots import PlotError
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.review.log import Log, ReviewError, read_log
from linkage_vibration.review.picture import draw_log, plot
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table
from test.support.drive import engine_and_pto_speed, hitch_duty_cycle

WriteLog = Callable[..., Path]
LIMIT, RED = 0.02, "#cc3311"  # of the parameters in the log


def drawn(log: Log) -> Figure:
    """Return the figure of a log."""
    figure = Figure(layout="constrained")
    draw_log(figure, log)
    return figure


@pytest.fixture(scope="module")
def loaded(write_log: WriteLog, tmp_path_factory: pytest.TempPathFactory) -> Log:
    """Return the log of the shipped drive, with load ratios that ascend over the drive."""
    times, alpha3 = hitch_duty_cycle()
    path = tmp_path_factory.mktemp("log") / "drive.mcap"
    log = read_log(write_log(path, list(times[::10]), list(alpha3[::10])))
    assert log.drive is not None
    ramp = np.linspace(0.0, 2.0 * LIMIT, len(log.drive.times))
    ratios = np.outer(ramp, [0.0, 0.0, 0.0, 0.1, 0.995, 0.0])
    columns = vars(log.drive.resonances) | {
        "load_ratios": ratios,
        "total_load_ratio": ramp,
        "total_load_ratio_factor": np.full_like(ramp, 1.1),
    }
    return replace(log, drive=replace(log.drive, resonances=MessageColumns(**columns)))


def test_modes_are_bands_of_their_deviation(loaded: Log) -> None:
    """Each mode is a line with a band of one standard deviation, and has its name beside it."""
    axes = drawn(loaded).axes[0]
    assert axes.get_yscale() == "log"
    bands = [path for band in axes.collections[:3] for path in band.get_paths()]
    for mode, (line, band) in enumerate(zip(axes.lines[:3], bands, strict=True)):
        frequencies = loaded.natural_frequencies[:, mode]
        np.testing.assert_array_equal(line.get_xdata(), loaded.times)
        np.testing.assert_array_equal(line.get_ydata(), frequencies)
        highest = (frequencies + loaded.frequency_stddevs[:, mode]).max()
        lowest = (frequencies - loaded.frequency_stddevs[:, mode]).min()
        vertices = np.asarray(band.vertices)[:, 1]
        assert (vertices.min(), vertices.max()) == pytest.approx((lowest, highest))
    texts = [text.get_text() for text in axes.texts]
    assert texts[:3] == ["implement heave", "implement pitch", "lift rod bending"]
    assert "pto_shaft 1" in texts


def test_excitations_are_as_wide_as_their_load(loaded: Log) -> None:
    """An order is at its frequency, wider with its load ratio, and red where that is too large."""
    times, _, pto = engine_and_pto_speed()
    orders = drawn(loaded).axes[0].collections[3:9]
    every = np.concatenate([np.asarray(each.get_linewidth()) for each in orders])
    assert every.max() > 5.0 * every.min()  # whatever the largest load is
    order = orders[4]  # pto_shaft 1, the fifth of the excitations
    segments = np.array([path.vertices for path in order.get_paths()])
    widths = np.asarray(order.get_linewidth())
    at = np.searchsorted(segments[:, 1, 0], 5.0)
    expected = np.interp(segments[at, 1, 0], times, pto) / 60.0
    assert segments[at, 1, 1] == pytest.approx(expected, rel=0.02)
    share = loaded.drive.resonances.load_ratios[1:, 4]  # type: ignore[union-attr]
    np.testing.assert_allclose(np.diff(widths), np.diff(share) * np.ptp(widths) / np.ptp(share))
    colours = [to_hex(colour) for colour in order.get_edgecolor()]
    assert [colour == RED for colour in colours] == (share > LIMIT).tolist()


def test_load_ratio_and_its_limit(loaded: Log) -> None:
    """The lower panel has the total with its band and its limit; what exceeds it is red."""
    upper, lower = drawn(loaded).axes
    total, above, limit = lower.lines
    ramp = loaded.drive.resonances.total_load_ratio  # type: ignore[union-attr]
    np.testing.assert_array_equal(total.get_ydata(), ramp)
    np.testing.assert_array_equal(np.isfinite(np.asarray(above.get_ydata())), ramp > LIMIT)
    assert set(np.asarray(limit.get_ydata())) == {LIMIT}
    band = np.asarray(lower.collections[0].get_paths()[0].vertices)[:, 1]
    assert band.max() == pytest.approx(1.1 * ramp[-1])
    half = loaded.times[-1] / 2.0
    for axes in (upper, lower):
        corners = np.asarray(axes.collections[-1].get_paths()[0].vertices)[:, 0]
        assert corners.min() == pytest.approx(half, abs=0.2)
    assert lower.get_xlabel() == "time [s]"
    assert lower.get_ylim()[0] == 0.0


def test_part_of_a_total_is_dotted(loaded: Log) -> None:
    """Where a source is not known, the total is a dotted line on a hatched ground, with words."""
    assert loaded.drive is not None
    unknown = np.where(loaded.drive.times < 8.0, 16, 0)
    columns = vars(loaded.drive.resonances) | {"unknown_sources": unknown}
    drive = replace(loaded.drive, resonances=MessageColumns(**columns))
    lower = drawn(replace(loaded, drive=drive)).axes[1]
    whole, part = (np.isfinite(np.asarray(line.get_ydata())) for line in lower.lines[:2])
    np.testing.assert_array_equal(whole, unknown == 0)
    np.testing.assert_array_equal(part, unknown != 0)
    assert lower.lines[1].get_linestyle() == ":"
    legend = lower.get_legend()
    assert legend is not None
    texts = [text.get_text() for text in legend.get_texts()]
    assert texts == ["total", "a part of the total", "a source is not known"]
    [hatch] = [each for each in lower.collections if each.get_hatch()]
    corners = np.asarray(hatch.get_paths()[0].vertices)[:, 0]
    assert corners.max() == pytest.approx(8.0, abs=0.15)


def test_unknown_loads_leave_the_modes(loaded: Log) -> None:
    """Without resonances, or with unknown load ratios, the modes alone are drawn."""
    assert len(drawn(replace(loaded, drive=None)).axes) == 1
    assert loaded.drive is not None
    unknown = np.full(len(loaded.drive.times), np.nan)
    columns = vars(loaded.drive.resonances) | {"total_load_ratio": unknown}
    drive = replace(loaded.drive, resonances=MessageColumns(**columns))
    assert len(drawn(replace(loaded, drive=drive)).axes) == 1
    assert Source.PTO in loaded.speeds


def test_what_is_missing_or_invalid_shows(write_log: WriteLog, tmp_path: Path) -> None:
    """Lines break and the background is shaded where predictions are invalid or missing."""
    times = [0.01 * k for k in range(100)] + [3 + 0.01 * k for k in range(100)]
    alpha3 = [2.0] * 40 + [math.radians(190)] * 20 + [2.0] * 90 + [math.nan] + [2.0] * 49
    log = read_log(write_log(tmp_path / "log.mcap", times, alpha3, speeds=False))
    [axes] = drawn(log).axes
    paths = [path for shades in axes.collections[3:] for path in shades.get_paths()]
    corners = [np.asarray(path.vertices)[:, 0] for path in paths]
    spans = sorted((seconds.min(), seconds.max()) for seconds in corners)
    np.testing.assert_allclose(spans, [(0.40, 0.60), (0.99, 3.0), (3.50, 3.51)])
    frequencies = np.asarray(axes.lines[0].get_ydata())
    # Index 99 is the last one before the gap.
    assert np.flatnonzero(np.isnan(frequencies)).tolist() == [*range(40, 60), 99, 150]


@pytest.mark.parametrize("count", [1, 2, 500])
def test_picture_is_a_png(write_log: WriteLog, tmp_path: Path, count: int) -> None:
    """A PNG of the documented size is written, even for a single prediction, and nothing else."""
    times = [0.01 * k for k in range(count)]
    log = read_log(write_log(tmp_path / "log.mcap", times, [2.0] * count))
    plot(log, tmp_path / "log.png")
    content = (tmp_path / "log.png").read_bytes()
    assert content[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", content[16:24]) == (1500, 1140)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.mcap", "log.png"]


def test_tables_and_predictions_are_drawn(tmp_path: Path) -> None:
    """Both show the same frequencies in the order of the angles; those of a table have names."""
    table = load_table(config_file("tables/three_point_linkage.npz"))
    angles = np.radians([170.0, 100.0, 130.0])
    few = plot(Predictor(table).predict(angles)).axes[0]
    whole = plot(table, tmp_path / "table.png").axes[0]
    assert (tmp_path / "table.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    for line, curve in zip(few.lines, whole.lines, strict=True):
        x, y = np.asarray(line.get_data(), dtype=float)
        np.testing.assert_allclose(x, [100.0, 130.0, 170.0])
        np.testing.assert_allclose(y, np.interp(x, *np.asarray(curve.get_data())), rtol=1e-3)
    assert [text.get_text() for text in few.texts] == ["mode 1", "mode 2", "mode 3"]
    assert "not known" not in few.get_title(loc="left")
    outside = plot(Predictor(table).predict(np.radians([80.0, 100.0, 130.0]))).axes[0]
    assert outside.get_title(loc="left").endswith("(no band: not known)")
    assert [text.get_text() for text in whole.texts] == list(table.mode_names)


def test_errors_name_the_place_and_the_remedy(
    write_log: WriteLog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A missing prediction, folder or matplotlib is reported."""
    with pytest.raises(ReviewError, match=r"empty\.mcap holds no prediction"):
        read_log(write_log(tmp_path / "empty.mcap", [], []))
    log = read_log(write_log(tmp_path / "log.mcap", [0.0, 0.01], [2.0, 2.1]))
    with pytest.raises(PlotError, match=r"a\.png: cannot be written"):
        plot(log, tmp_path / "nowhere" / "a.png")
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(PlotError, match=r"pip install linkage_vibration\[plots\]"):
        plot(log, tmp_path / "a.png")
