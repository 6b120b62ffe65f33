# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the page says of measured vibration beside a log, and what it says is not known."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from linkage_vibration.drawing import palette
from linkage_vibration.listening import drive_modes
from linkage_vibration.listening.amplitudes import MeasuredOrder
from linkage_vibration.listening.drive_modes import DriveMode, MeasuredDrive, why_no_modes
from linkage_vibration.listening.output_only import PausableTask
from linkage_vibration.listening.signals import Signal
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.review import listening_page
from linkage_vibration.review.listening_page import (
    answers,
    compare_sensor,
    heard_modes,
    is_calm,
    modes_answer,
)
from linkage_vibration.review.log import Log, ReviewError, read_log
from linkage_vibration.support.resources import PAPER_MECHANISM, config_file
from test.listening.test_signals import sensor
from test.review.conftest import WriteLog

RATE = 200.0  # Hz


@pytest.fixture(scope="module")
def log(write_log: WriteLog, tmp_path_factory: pytest.TempPathFactory) -> Log:
    """Return a log of 40 s without faults."""
    times = np.arange(0.0, 40.0, 0.05)
    path = tmp_path_factory.mktemp("heard") / "log.mcap"
    return read_log(write_log(path, times.tolist(), (2.4 + 0.1 * np.sin(times)).tolist()))


def shaken(log: Log, start: float, end: float) -> Signal:
    """Return a signal of 10 Hz and 1 m/s2 along z, in noise, around the times of a log."""
    times = np.arange(start, log.times[-1] + end, 1.0 / RATE)
    values = np.random.default_rng(2).normal(0.0, 0.01, (len(times), 3))
    values[:, 2] += np.sin(2.0 * np.pi * 10.0 * times)
    return Signal(sensor(), times, values, RATE, ())


def test_a_level_is_not_known_where_a_speed_or_the_angle_is_not(log: Log) -> None:
    """It is known inside the log; not where the engine's speed is NaN, and not outside of the log.

    A PTO that the log lacks is named, and one at rest adds nothing.
    """
    times = log.times
    known = np.where(times < 20.1, 1500.0, np.nan)
    engine = {Source.ENGINE: (times, known)}
    both = engine | {Source.PTO: (times, np.zeros(len(times)))}
    signal = shaken(log, 0.0, 8.0)
    actual = [compare_sensor(replace(log, speeds=each), signal) for each in (engine, both)]
    assert [Source.PTO.value in each.unknown for each in actual] == [True, False]
    for each in actual:
        middle = each.orders.times
        np.testing.assert_array_equal(np.isfinite(each.predicted), middle < 20.0)
    np.testing.assert_array_equal(actual[0].predicted, actual[1].predicted)


MODE = DriveMode(2.5, 0, 8.0, 0.08, 0.003, 7.6, 0.038, 0.02, 0.002, (20.0,))
FAR = replace(MODE, predicted_stddev=0.01)
UNKNOWN = replace(MODE, predicted_stddev=math.nan)
DOUBTFUL = replace(FAR, doubt="a reason")


@pytest.mark.parametrize(
    ("modes", "words", "explained"),
    [
        ([], "No natural frequency was found. ", False),
        ([DOUBTFUL], "None of 1 natural frequencies is reported. The mode 1 at 143.2 deg", False),
        ([MODE, DOUBTFUL], "5.0 % lower than predicted, 7.600 +- 0.038 Hz: consistent", False),
        ([UNKNOWN], "not known, because the deviation of the prediction is not known", False),
        ([MODE, FAR], "not consistent, 4.4 standard deviations. 1 of 2 measured", True),
    ],
)
def test_modes_answer(log: Log, modes: list[DriveMode], words: str, explained: bool) -> None:
    """The worst mode that is reported is the answer; what may explain it stands in the table."""
    named = modes_answer(log, modes, [compare_sensor(log, shaken(log, 0.0, 0.0))]).replace(
        log.mode_name(0), "mode 1"
    )
    assert words in named
    page = listening_page.listening_page(log, [compare_sensor(log, shaken(log, 0.0, 0.0))], modes)
    assert "± nan" not in page
    assert ("may be explained by a change of" in page) == explained
    assert "class=calm" not in page  # No order was compared.


def order(log: Log, apart: float, *, is_detected: bool = True) -> MeasuredOrder:
    """Return an order whose ln(measured over predicted) is given, with a deviation of 0.5."""
    factor = math.exp(0.5)
    numbers = (10, math.exp(apart), 0.0, 1.0, factor, math.nan, math.nan)
    return MeasuredOrder(log.excitations[3], *numbers, is_detected)


@pytest.mark.parametrize(
    ("apart", "is_detected", "words"),
    [
        (0.99, True, ""),
        (-0.99, True, ""),
        (1.01, True, "2.7 times stronger than predicted, which its deviations do not allow"),
        (-1.01, True, "2.7 times weaker than predicted"),
        (-5.0, False, "probably its amplitude in the excitation file is at least 150 times too l"),
        (-0.99, False, ""),
        (5.0, False, ""),
    ],
)
def test_contradictions_come_first(log: Log, apart: float, is_detected: bool, words: str) -> None:
    """Beyond two deviations, factor and probable cause begin the answer, and it is not green.

    What noise hides is not known to agree, so it does not count as compared.
    """
    row = order(log, apart, is_detected=is_detected)
    heard = replace(compare_sensor(log, shaken(log, 0.0, 0.0)), rows=[row], compared=0.95)
    said = answers(log, [heard], [MODE])
    assert (words in said[0]) if words else said[0].startswith("The ")
    assert said[0].startswith("engine_shake 1.5 at imu is ") == bool(words)
    assert f" of {int(row.is_compared)} order" in said[-1]
    assert row.is_compared == (is_detected or bool(words))
    assert is_calm([heard], [MODE]) == (not words)


def test_the_largest_contradiction_comes_first(log: Log) -> None:
    """It is that of the largest factor, however strong the orders are."""
    rows = [order(log, 1.5), replace(order(log, -3.0), measured=math.exp(-3.0))]
    rows[1] = replace(rows[1], measured=10.0 * rows[1].measured, predicted=10.0)
    heard = replace(compare_sensor(log, shaken(log, 0.0, 0.0)), rows=rows)
    text = answers(log, [heard], [MODE])[0]
    assert -1 < text.index("20 times weaker") < text.index("4.5 times stronger")


@pytest.mark.parametrize(("shift", "known"), [(39.9, True), (40.1, False), (-44.1, False)])
def test_sensors_of_another_time(log: Log, shift: float, known: bool) -> None:
    """A signal that ends before a drive or begins after it is refused, with both times."""
    signal = shaken(log, 0.0, 4.0)
    moved = replace(signal, times=signal.times + shift)
    if known:
        compare_sensor(log, moved)
        return
    with pytest.raises(ReviewError, match=r"and the drive ends at 39.95 s; correct the clocks of"):
        compare_sensor(log, moved)


def test_what_was_not_compared_is_not_green(log: Log) -> None:
    """95 % of the predicted mean square has to be compared, and a mode; less is said in words."""
    heard = replace(
        compare_sensor(log, shaken(log, 0.0, 0.0)), rows=[order(log, 0.0)], compared=0.95
    )
    less = replace(heard, compared=0.949)
    assert is_calm([heard], [MODE])
    assert not is_calm([heard], [])
    assert not is_calm([heard], [FAR])
    assert not is_calm([heard, less], [MODE])
    words = "They make 94 % of what is predicted; whether the rest agrees is not known."
    assert words in answers(log, [less], [MODE])[-1]
    assert words not in answers(log, [heard], [MODE])[-1]


def test_share_that_was_compared(log: Log) -> None:
    """An order as strong as predicted is compared; without the speed of another, none is."""
    constant = np.full(len(log.times), 2.5)
    engine = {Source.ENGINE: (log.times, np.full(len(log.times), 1500.0))}
    still = replace(log, crank_angle=constant, speeds=engine)
    [shake] = [each for each in log.excitations if each.load and each.source is Source.ENGINE]
    alone = replace(still, excitations=(shake,))
    first = compare_sensor(alone, shaken(log, 0.0, 0.0)).rows[0]
    signal = shaken(log, 0.0, 0.0)
    tone = np.sqrt(2.0) * first.predicted * np.sin(2.0 * np.pi * 37.5 * signal.times)
    signal = replace(signal, values=0.001 * signal.values + np.outer(tone, [0.0, 0.0, 1.0]))
    assert compare_sensor(alone, signal).compared == pytest.approx(1.0, abs=0.15)
    assert compare_sensor(still, signal).compared == 0.0


def silence(log: Log, angles: np.ndarray, signals: list[Signal]) -> str:
    """Return why no mode was found with crank angles, rad, at the times of a log."""
    assert log.table is not None
    return why_no_modes(log.table, signals, (log.times, angles))


def test_silence_is_explained(log: Log) -> None:
    """The condition that is not met is named with its numbers, on both sides of its threshold."""
    assert log.table is not None
    low, high = log.table.alpha3_range
    middle, t = 0.5 * (low + high), log.times
    still, signal = np.full(len(t), middle), shaken(log, 0.0, 0.0)
    assert silence(log, still, []) == "No sensor measures accelerations on the linkage."
    for seconds, words in (
        (7.0, "known at once for 7 s, and modes need 8 s"),
        (8.5, "No estimate"),
    ):
        short = signal.times <= seconds
        cut = replace(signal, times=signal.times[short], values=signal.values[short])
        assert words in silence(log, still, [signal, cut])
    outside = f"is never between {math.degrees(low):.4g} and {math.degrees(high):.4g} deg"
    assert outside in silence(log, still + 10.0, [signal])
    for rate, words in (
        (1.1, "moves less than 1 deg/s within the table for at most"),
        (0.9, "No e"),
    ):
        moving = middle + np.radians(rate) * (t - t.mean())
        assert words in silence(log, moving, [signal])
    for stop, words in ((7.0, "s at a time, and modes need 8 s"), (9.0, "No estim")):
        late = middle + np.radians(3.0) * np.maximum(t - stop, 0.0)
        assert words in silence(log, late, [signal])
    lowest = float(log.table.evaluate(np.array([middle]))[0, 0])
    for share, words in (
        (0.97, f"lowest predicted mode is at {lowest:.3g} Hz"),
        (1.03, "No estim"),
    ):
        slow = replace(signal, rate=share * lowest / 0.3)
        assert words in silence(log, still, [slow])


@pytest.mark.parametrize("gap", [0.0, 2.0])
def test_no_mode_is_sought_in_a_gap(log: Log, gap: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two sensors share their times, and the angle is not known in a gap of one of them."""
    given: list[MeasuredDrive] = []

    def listen(drive: MeasuredDrive) -> PausableTask[tuple[DriveMode, ...]]:
        given.append(drive)
        yield
        return ()

    monkeypatch.setattr(drive_modes, "search_modes", listen)
    whole, late = shaken(log, 0.0, 0.0), shaken(log, 5.0, 0.0)
    kept = (whole.times < 10.0) | (whole.times > 10.0 + gap)
    whole = replace(whole, times=whole.times[kept], values=whole.values[kept])
    heard_modes(log, [compare_sensor(log, each) for each in (whole, late)])
    times, unknown = given[0].times, np.isnan(given[0].angle)
    assert (times[0], given[0].signals.shape[1]) == (5.0, 4)
    assert unknown.any() == (gap > 0.0)
    np.testing.assert_array_equal(unknown[(times > 9.81) & (times < 12.19)], gap > 0.0)
    assert not unknown[(times < 9.79) | (times > 12.21)].any()


def test_load_ratio_of_a_pin(log: Log) -> None:
    """A force of 1000 N rms is divided by the static force of the model, if that is known."""
    angle = np.full(len(log.times), 2.5)
    moving = shaken(replace(log, crank_angle=angle), 0.0, 0.0)
    force = sensor(at="lower_link:P1.force_x", accelerates=False, axes=np.eye(1))
    tone = 1000.0 * math.sqrt(2.0) * moving.values[:, 2:]
    signal = replace(moving, sensor=force, values=tone)
    static = LinkageModel(read_mechanism(config_file(PAPER_MECHANISM))).static_forces(2.5)[0]
    heard = compare_sensor(replace(log, crank_angle=angle), signal)
    np.testing.assert_allclose(heard.measured / heard.reference, 1000.0 / static, rtol=0.01)
    said = answers(log, [heard], ())[-1]
    assert f"Its load ratio is up to {1000.0 / static:.2g}; that of" in said
    assert log.table is not None
    unknown = replace(log.table, static_forces=np.full_like(log.table.static_forces, np.nan))
    for other in (
        replace(log, crank_angle=angle, table=unknown),
        replace(log, crank_angle=4.0 + angle),
    ):
        assert "load ratio" not in answers(log, [compare_sensor(other, signal)], ())[-1]


def test_a_dead_axis_and_sensors_that_hardly_meet(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An axis of zeros is left out; no mode is sought without signals, or in less than 8 s."""
    places: list[object] = []

    def listen(drive: MeasuredDrive) -> PausableTask[tuple[DriveMode, ...]]:
        places.append(drive.places)
        yield
        return ()

    monkeypatch.setattr(drive_modes, "search_modes", listen)
    signal = shaken(log, 0.0, 0.0)
    first, dead = (replace(signal, values=signal.values * gain) for gain in ([0, 0, 1], [0, 0, 0]))
    heard = [compare_sensor(log, first), compare_sensor(log, dead)]
    assert heard_modes(log, heard) == heard_modes(log, heard[1:]) == ()
    assert places == [[("E1", "z")]]
    assert "No natural frequency was found" in listening_page.listening_page(log, heard, ())
    late = replace(signal, times=signal.times + signal.times[-1] - 7.0)
    heard_modes(log, [compare_sensor(log, first), compare_sensor(log, late)])
    assert len(places) == 1


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("unknown", [(), ("pto",)])
def test_levels_are_bands_of_one_deviation(log: Log, force: bool, unknown: tuple[str, ...]) -> None:
    """A level of 2 mm/s whose deviation is a factor of 1.65 is a band from 1.21 to 3.30 mm/s.

    A force of 0.002 N is drawn over that at rest, of 0.004 N, beside the limit of a warning.
    """
    heard = compare_sensor(log, shaken(log, 0.0, 0.0))
    level = np.full_like(heard.predicted, 0.002)
    given = replace(heard, rows=[order(log, 0.0)], predicted=level, measured=2.0 * level)
    given = replace(given, unknown=unknown)
    scale = 1000.0
    if force:
        place = sensor(at="lower_link:P1.force_x", accelerates=False, axes=np.eye(1))
        given = replace(given, signal=replace(given.signal, sensor=place), reference=2.0 * level)
        scale = 250.0
    axes = Figure().subplots()
    listening_page._draw_levels(axes, given, limit=0.33)
    band = np.asarray(axes.collections[0].get_paths()[0].vertices)[:, 1]
    assert (band.min(), band.max()) == pytest.approx((1.213e-3 * scale, 3.297e-3 * scale), rel=1e-3)
    *limit, predicted, measured = axes.lines
    assert set(np.asarray(predicted.get_ydata()) / scale) == {0.002}
    assert set(np.asarray(measured.get_ydata()) / scale) == {0.004}
    assert predicted.get_color() == to_hex(axes.collections[0].get_facecolor()).upper()
    assert measured.get_color() == palette.INK
    assert [set(np.asarray(line.get_ydata())) for line in limit] == [{0.33}] * force
    assert axes.get_ylabel() == ("load ratio [1]" if force else "rms [mm/s]")
    assert axes.get_ylim() == pytest.approx((0.5 * 1.213e-3 * scale, 2.0 * 4e-3 * scale), rel=1e-3)
    assert ("without pto, whose speed the log lacks" in str(predicted.get_label())) == bool(unknown)


@pytest.mark.parametrize(("hidden", "nameless"), [(None, "engine 0.5"), (3, "engine_shake 1.5")])
def test_spectrum_beside_predictions(log: Log, hidden: int | None, nameless: str) -> None:
    """A tone of 10 Hz is darkest at 10 Hz; modes are bands of two deviations, orders are dotted.

    The five strongest of those that noise does not hide are drawn, with their names.
    """
    speeds = {Source.ENGINE: 1500.0, Source.PTO: 1000.0}
    known = {of: (log.times, np.full(len(log.times), speed)) for of, speed in speeds.items()}
    signal = shaken(log, 0.0, 0.0)
    signal = replace(signal, values=signal.values * [0.0, 0.0, 1.0])
    heard = compare_sensor(replace(log, speeds=known), signal)
    rows = [
        replace(order(log, 0.1 * i, is_detected=i != hidden), excitation=each)
        for i, each in enumerate(log.excitations)
    ]
    axes = Figure().subplots()
    listening_page._draw_spectrogram(axes, log, replace(heard, rows=rows))
    [mesh] = (each for each in axes.collections if isinstance(each, QuadMesh))
    power = np.asarray(mesh.get_array()).mean(axis=1)
    edges = np.asarray(mesh.get_coordinates())[:, 0, 1]
    middles = (edges[1:] + edges[:-1]) / 2.0
    assert middles[power.argmax()] == pytest.approx(10.0, abs=0.5)
    # A tone of 1 m/s2 has a mean square of 0.5 (m/s2)2, which is the area of its peak.
    near = np.abs(middles - 10.0) < 3.0
    area = (10.0 ** (power[near] / 10.0)).sum() * (middles[1] - middles[0])
    assert area == pytest.approx(0.5, rel=0.01)
    assert axes.get_ylim()[1] == 0.5 * RATE
    curves = [line for line in axes.lines if line.get_linestyle() == "-"]
    np.testing.assert_array_equal([line.get_ydata() for line in curves], log.natural_frequencies.T)
    assert [line.get_color() for line in curves] == palette.mode_colours(log.n_modes)
    band = np.vstack([p.vertices for p in axes.collections[1].get_paths()])[:, 1]
    upper = log.natural_frequencies[:, 0] + 2.0 * log.frequency_stddevs[:, 0]
    assert np.nanmax(band) == pytest.approx(np.nanmax(upper))
    dotted = [line for line in axes.lines if line.get_linestyle() == ":"]
    names = [each.name for each in log.excitations if each.name != nameless]
    lines = sorted(float(np.nanmax(line.get_ydata())) for line in dotted)
    of_names = {each.name: each.ratio * speeds[each.source] for each in log.excitations}
    assert lines == pytest.approx(sorted(of_names[name] for name in names), rel=1e-3)
    texts = [text.get_text() for text in axes.texts]
    assert sorted(texts[-5:]) == sorted(names)
    modes = [log.mode_name(mode) or f"mode {mode + 1}" for mode in range(log.n_modes)]
    assert set(texts[:-5]) <= set(modes)


def test_table_of_orders(log: Log) -> None:
    """Each cell is a number of the order; what is not known or only bounded says so."""
    known = MeasuredOrder(log.excitations[3], 12, 0.5, 0.021, 0.25, 2.0, 123.4, 0.25, True)
    bounded = MeasuredOrder(log.excitations[1], 7, 0.12, 0.0, 0.48, 2.0, math.nan, math.nan, False)
    unknown = math.nan, math.nan, math.nan, math.nan
    alone = MeasuredOrder(log.excitations[2], 3, 0.5, 0.01, *unknown, True)
    heard = replace(compare_sensor(log, shaken(log, 0.0, 0.0)), rows=[known, bounded, alone])
    text = listening_page._orders_table(heard)
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in text.split("<tr>")[2:]]
    load = known.excitation.load
    assert load is not None
    # ln 2 over hypot(ln 2, 0.021 / 0.5), and ln(1/4) over ln 2 at most.
    amplitude = f"123 ± 25 %, not {load.amplitude:g} {load.kind.unit}"
    assert rows == [
        [known.excitation.name, "12", "0.5 ± 0.021", "0.25 (× or ÷ 2)", "+1.0", amplitude],
        [bounded.excitation.name, "7", "below 0.12 (noise)", "0.48 (× or ÷ 2)", "at most -2.0", ""],
        [alone.excitation.name, "3", "0.5 ± 0.01", "not known", "", ""],
    ]
    assert "measured, rms [m/s²]" in text


def test_orders_that_cannot_be_compared(log: Log) -> None:
    """What stands out without a prediction, and what noise hides, are counted apart."""
    alone = replace(order(log, 0.0), predicted=math.nan, predicted_factor=math.nan)
    hidden = order(log, 1.0, is_detected=False)
    heard = replace(compare_sensor(log, shaken(log, 0.0, 0.0)), compared=0.95)
    said = [
        answers(log, [replace(heard, rows=[order(log, 0.0), *more])], [MODE])[-1]
        for more in ([], [alone], [hidden], [alone, alone, hidden, hidden])
    ]
    assert "more order" not in said[0]
    assert said[1].endswith("1 more order above the noise cannot be predicted.")
    assert said[2].endswith("1 more order cannot be distinguished from the noise.")
    assert "2 more orders above the noise cannot be predicted. 2 more orders cannot be" in said[3]
