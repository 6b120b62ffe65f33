# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The page begins with the answer, and its numbers are those of the log."""

import html
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linkage_vibration.cli.main import main
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.resonance import ResonanceState
from linkage_vibration.review import findings
from linkage_vibration.review.findings import amplification, first_sentence, meetings
from linkage_vibration.review.log import Log, problems, read_log
from linkage_vibration.review.moments import Moment, angle_shares, moments
from linkage_vibration.review.overview import drive_summary, overview_html
from linkage_vibration.review.review_page import review_page
from linkage_vibration.review.time_axis import time_axis
from test.support.drive import hitch_duty_cycle
from test.support.messages import changed

GAP, BACK = 900.0, 10.0  # s


@pytest.fixture(scope="module")
def log(drive: Path) -> Log:
    """Return the log of the drive."""
    return read_log(drive)


@pytest.fixture(scope="module")
def jumping(write_log: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a log with a gap of 15 min after 8 s, whose clock then begins again."""
    times, alpha3 = hitch_duty_cycle()
    late = np.where(times > 8.0, times + GAP, times)
    again = times < BACK
    path = tmp_path_factory.mktemp("jumping") / "jumping.mcap"
    stamps = np.concatenate([late, times[again]])
    return Path(write_log(path, stamps, np.concatenate([alpha3, alpha3[again] + 0.02])))


def test_amplification_is_that_of_a_mode(log: Log) -> None:
    """The strongest moment of each pair is found by a plain loop over all predictions."""
    met, found = meetings(log, moments(log)), log.resonances
    assert found is not None
    assert [one.amplification for one in met] == sorted(
        (m.amplification for m in met), reverse=True
    )
    for one in met:
        here = (found.state == ResonanceState.WARNING) & (found.excitation == one.excitation)
        here &= found.mode == one.mode
        values = []
        for i in np.flatnonzero(here):
            r = found.excitation_frequency[i] / found.natural_frequency[i]
            zeta = log.damping_ratios[i, one.mode]
            values.append(1.0 / math.sqrt((1.0 - r**2) ** 2 + (2.0 * zeta * r) ** 2))
        assert one.amplification >= 0.999 * max(values)
        assert one.amplification <= 1.0001 / (2.0 * np.nanmin(log.damping_ratios[:, one.mode]))
        assert math.isnan(one.amplification_stddev)  # that of the damping ratio is not known
        assert one.count == sum(
            m.excitation == one.excitation and m.mode == one.mode for m in moments(log)
        )


def test_standard_deviation_by_an_independent_sample(log: Log) -> None:
    """Where both deviations are known, that of the amplification is the one of a random sample."""
    assert log.table is not None
    table = replace(log.table, parameter_stddev=np.full((2, 257, log.n_modes), 0.1))
    known = replace(log, table=table, damping_ratio_stddev=0.1 * log.damping_ratios)
    one = meetings(known, moments(known))[0]
    assert log.resonances is not None
    random, n, i = np.random.default_rng(3), 200_000, one.strongest
    frequency = random.normal(
        log.natural_frequencies[i, one.mode], log.frequency_stddev[i, one.mode], n
    )
    zeta = random.normal(log.damping_ratios[i, one.mode], 0.1 * log.damping_ratios[i, one.mode], n)
    r = log.resonances.excitation_frequency[i] / frequency
    sample = 1.0 / np.sqrt((1.0 - r**2) ** 2 + (2.0 * zeta * r) ** 2)
    assert one.amplification_stddev == pytest.approx(sample.std(), rel=0.05)
    assert "standard deviation not known" not in findings.in_words(one)


@pytest.mark.parametrize(("frequency", "ratio"), [(True, False), (False, True)])
def test_deviations_that_reach_zero(log: Log, frequency: bool, ratio: bool) -> None:
    """Where a frequency or a damping ratio may be zero, the deviation is not known.

    The outermost of nine points of Gauss and Hermite is 4.5127 standard deviations away.
    """
    assert log.table is not None
    table = replace(log.table, parameter_stddev=np.full((2, 257, log.n_modes), 0.1))
    for share, known in ((0.99 / 4.5127, True), (1.01 / 4.5127, False)):
        shares = [share if uncertain else 0.01 for uncertain in (frequency, ratio)]
        made = replace(
            log,
            table=table,
            frequency_stddev=shares[0] * log.natural_frequencies,
            damping_ratio_stddev=shares[1] * log.damping_ratios,
        )
        one = meetings(made, moments(made))[0]
        assert math.isfinite(one.amplification_stddev) == known


def test_first_sentence(log: Log) -> None:
    """The sentence names the moment, the order, the mode, the strength, and what to avoid."""
    met = meetings(log, moments(log))
    text, worst = first_sentence(log, met), met[0]
    for part in (
        f"{log.times[worst.strongest]:.2f} s",
        f"{worst.excitation} met {log.mode_label(worst.mode)} for ",
        f"{worst.amplification:.3g} times (standard deviation not known)",
        " rpm between ",
    ):
        assert part in text
    none = replace(log, resonances=None)
    assert first_sentence(none, []).startswith("Whether the drive met a resonance is not known")
    assert log.resonances is not None
    state = np.zeros_like(log.resonances.state)
    clear = replace(log, resonances=changed(log.resonances, state=state))
    assert "No excitation came near a natural frequency; the nearest was" in first_sentence(
        clear, []
    )


def test_what_to_avoid_holds(log: Log) -> None:
    """At the avoided speeds and angles of the worst moment, its excitation is near its mode."""
    worst = meetings(log, moments(log))[0]
    words = worst.avoid.split()
    low, high, unit, first, last = words[1], words[3], words[4], words[6], words[8]
    assert unit == "rpm"
    assert float(first) <= np.rad2deg(log.crank_angle[worst.strongest]) <= float(last)
    [one] = [e for e in log.excitations if e.name == worst.excitation]
    assert log.resonances is not None
    speed = log.resonances.excitation_frequency[worst.strongest] / one.ratio
    assert float(low) <= speed <= float(high)
    assert float(high) / float(low) < 1.35  # 10 % on each side


def made_up_moment(log: Log, excitation: str, hertz: float, degrees: tuple[float, float]) -> Any:
    """Return a log in which one mode stays at a frequency over 50 predictions, and its moment."""
    rows, mode = slice(100, 150), 1
    frequencies, angles = log.natural_frequencies.copy(), log.crank_angle.copy()
    frequencies[rows, mode] = hertz
    angles[rows] = np.radians(np.linspace(*degrees, 50))
    own = replace(log, natural_frequencies=frequencies, crank_angle=angles)
    period = float(log.times[100]), float(log.times[149])
    numbers = hertz, hertz, 0.0, True
    return own, Moment(*period, 100, 149, 120, excitation, mode, *numbers)


@pytest.mark.parametrize(
    ("excitation", "hertz", "degrees", "avoid"),
    [
        # 0.9 and 1.1 times 10.03 Hz are 541.62 and 661.98 rpm.
        ("own", 10.03, (101.2, 111.7), "engine 540 to 665 rpm between 101 and 112 deg"),
        # 540 and 660 rpm, which are steps of 5 rpm but for rounding; the PTO turns half as fast.
        ("shaft", 10.02, (101.7, 111.2), "PTO 270 to 335 rpm between 101 and 112 deg"),
        # 9.018 and 11.022 Hz at 4 per metre are 2.2545 and 2.7555 m/s.
        ("lugs", 10.02, (120.0001, 120.9), "ground 2.2 to 2.8 m/s between 120 and 121 deg"),
        ("strange", 10.02, (150.5, 99.5), "9.0 to 11.0 Hz of strange between 99 and 151 deg"),
        ("own", 10.03, (100.0, 460.5), "engine 540 to 665 rpm at all angles"),
    ],
)
def test_ranges_to_avoid_are_rounded_outwards(
    log: Log, excitation: str, hertz: float, degrees: tuple[float, float], avoid: str
) -> None:
    """The ranges hold every speed and angle that is too near, found on paper, and little more."""
    made, moment = made_up_moment(log, excitation, hertz, degrees)
    described = (
        Excitation("own", Source.ENGINE, 1.0 / 60.0),
        Excitation("shaft", Source.PTO, 1.0 / 30.0),
        Excitation("lugs", Source.GROUND, 4.0),
    )
    made = replace(made, excitations=described, parameters={"warning_margin": 0.1})
    [found] = meetings(made, [moment])
    assert found.avoid == avoid


def test_angles_to_avoid_are_those_of_the_table(log: Log) -> None:
    """A crank in its third turn has the angles of the first one, to which the table belongs."""
    made, moment = made_up_moment(log, "strange", 100.0, (100.5, 110.5))
    assert made.table is not None
    turning = replace(made.table, alpha3=np.linspace(0.0, 2.0 * np.pi, len(made.table.alpha3)))
    turned = replace(made, table=turning, crank_angle=made.crank_angle + 4.0 * np.pi)
    for own in (made, turned):
        [found] = meetings(own, [moment])
        assert found.avoid.endswith(" between 100 and 111 deg")


def test_margin_of_the_ranges_to_avoid(log: Log) -> None:
    """The margin is that of the log, and 10 % where the log does not hold it."""
    made, moment = made_up_moment(log, "strange", 100.0, (100.0, 110.0))
    for parameters, avoid in (({"warning_margin": 0.25}, "75.0 to 125.0"), ({}, "90.0 to 110.0")):
        [found] = meetings(replace(made, excitations=(), parameters=parameters), [moment])
        assert found.avoid.startswith(f"{avoid} Hz of strange between ")


def test_only_invalid_angles(write_log: Any, tmp_path: Path) -> None:
    """Warnings are not known if no angle was valid."""
    times = np.arange(50) / 100.0
    path = write_log(tmp_path / "nan.mcap", times, np.full(50, np.nan))
    log = read_log(path)
    assert "is not known, as no crank angle was valid" in first_sentence(log, [])
    cards = {card["label"]: card["value"] for card in review_page(log).content["summary"]}
    assert cards["Resonance warnings"] == "not known"


def test_jump_of_the_clock(jumping: Path) -> None:
    """Both passes are kept apart, in the order in which they were written."""
    log = read_log(jumping)
    assert log.passes.tolist() == [2000]
    assert (np.diff(log.times) > 0.0).all()
    assert (np.diff(log.stamps)[[1999]] < 0).all()
    np.testing.assert_array_equal(log.stamps[:1000][:800], log.stamps[2000:2800])
    np.testing.assert_allclose(log.crank_angle[2000:2800] - log.crank_angle[:800], 0.02)
    found = log.resonances
    assert found is not None
    assert (found.natural_frequency[2000:2100] != found.natural_frequency[:100]).all()
    assert "The clock jumped back once." in problems(log)


def test_long_gap_is_short_on_the_axis(jumping: Path) -> None:
    """A gap of 15 min takes 3 % of the recorded time, and real times come from the knots."""
    log = read_log(jumping)
    axis = time_axis(log)
    shown = axis.place(log.times)
    assert (np.diff(shown) > 0.0).all()
    assert shown[-1] < 35.0
    back = np.interp(shown, axis.shown, axis.real)
    np.testing.assert_allclose(back, (log.stamps - log.stamps[0]) / 1e9, atol=1e-6)
    whole = read_log(jumping)
    assert len(axis.shortened) == 1
    assert axis.shortened[0][1] - axis.shortened[0][0] == pytest.approx(GAP, abs=0.1)
    assert whole.path == jumping


def test_crank_that_turns_around(log: Log) -> None:
    """The share of time over the angle counts all turns."""
    assert log.table is not None
    turning = replace(log.table, alpha3=np.linspace(0.0, 2.0 * np.pi, len(log.table.alpha3)))
    known = np.isfinite(log.crank_angle)
    turned = np.where(known, log.crank_angle + 6.0 * np.pi, np.nan)
    around = replace(log, table=turning, crank_angle=turned)
    np.testing.assert_allclose(around.table_angle[known], log.crank_angle[known], atol=1e-9)
    one, other = angle_shares(around), angle_shares(replace(log, table=turning))
    np.testing.assert_allclose(one[1], other[1], atol=1e-3)
    assert one[1].sum() > 0.9


def test_amplification_without_resonances(log: Log) -> None:
    """It is zero where nothing is known."""
    assert not amplification(replace(log, resonances=None), []).any()


@pytest.fixture(scope="module")
def overview(drive: Path, jumping: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of two logs and a damaged one, with their overview and pages."""
    folder = tmp_path_factory.mktemp("logs")
    for path in (drive, jumping):
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "cut.mcap").write_bytes(drive.read_bytes()[:1000])
    assert main(["review", str(folder), "-o", str(folder / "all.html")]) == 0
    return folder


def test_overview(overview: Path, capsys: Any) -> None:
    """The overview has a row for each drive with a link to its page, and names a damaged log."""
    text = (overview / "all.html").read_text()
    for name in ("drive", "jumping"):
        assert f'<a href="{name}.html">{name}.mcap</a>' in text
        assert (overview / f"{name}.html").exists()
    assert "cut.mcap is damaged" in text
    assert main(["review", str(overview), "--csv", str(overview / "a.csv")]) == 1
    assert "take one log" in capsys.readouterr().err


def test_overview_of_logs_with_one_name(write_log: Any, tmp_path: Path) -> None:
    """Each log has a page of its own, also beside a log with the name of the overview."""
    logs = [tmp_path / day / "log.mcap" for day in ("1", "2 & 3")] + [tmp_path / "overview.mcap"]
    for path in logs:
        path.parent.mkdir(exist_ok=True)
        write_log(path, [0.0, 0.01], [2.0, 2.1], False, False)
    assert main(["review", *map(str, logs), "-o", str(tmp_path / "overview.html")]) == 0
    text = (tmp_path / "overview.html").read_text()
    for page, log in zip(("log", "log_2", "overview_2"), logs, strict=True):
        assert f'<a href="{page}.html">{html.escape(str(log))}</a>' in text
        assert (tmp_path / f"{page}.html").exists()


def test_overview_escapes_names(log: Log) -> None:
    """A name of a mode or of a file is text, never a part of the page."""
    text = "<script>alert('1')</script>"
    found = {**drive_summary(log), "log": text, "sentence": text, "mode_names": [text] * 3}
    text = overview_html([(found, "a b#.html")], [text])
    assert "<script>" not in text
    assert 'href="a%20b%23.html"' in text


def test_messages_that_were_dropped_are_a_problem(log: Log) -> None:
    """The last count in the metadata is shown; a log without losses has no such sentence."""
    name = "linkage_vibration.recording"
    records = {
        name: {"dropped": "0"},
        f"{name}.2": {"dropped": "7"},
        f"{name}.3": {"dropped": "90"},
    }
    assert any("lacks 90 messages" in text for text in problems(replace(log, metadata=records)))
    complete = replace(log, metadata={name: {"dropped": "0"}})
    assert not any("lacks" in text for text in problems(complete))


def test_summary_is_json(drive: Path, jumping: Path, capsys: Any, log: Log) -> None:
    """The same as JSON, with null for what is not known."""
    assert main(["summary", str(drive), str(jumping)]) == 0
    first, second = json.loads(capsys.readouterr().out)
    assert first["sentence"] == first_sentence(log, meetings(log, moments(log)))
    assert first["worst"]["amplification_stddev"] is None
    assert first["predictions"] == len(log.stamps)
    assert sum(first["in_resonance_s"]) > sum(m.end - m.start for m in moments(log))
    assert (second["clock_jumps"], second["gaps"]) == (1, 1)
    assert first["mode_names"] == (list(log.table.mode_names) if log.table else [])
    shared = overview_html([(first, "a.html")], [])
    other = overview_html([(first, "a.html"), ({**second, "mode_names": ["sway"]}, "b.html")], [])
    assert f"near {first['mode_names'][0]} [s]" in shared
    assert "near mode 1 [s]" in other  # the drives have modes of other names


@pytest.fixture
def page(browser: Any, overview: Path) -> Iterator[Any]:
    """Return the browser with the page of the jumping log."""
    browser.problems.clear()
    browser.resize(1280, 900)
    browser.open(overview / "jumping.html")
    yield browser
    assert browser.problems == []


def test_page_begins_with_the_answer(page: Any, jumping: Path) -> None:
    """The sentence and the pairs come first, and the cursor is at the worst moment."""
    log = read_log(jumping)
    met = meetings(log, moments(log))
    assert page.text("#answer") == first_sentence(log, met)
    rows = page.evaluate("[...document.querySelectorAll('#table-meetings tbody tr')].length")
    assert rows == min(6, len(met))
    assert page.evaluate("review.cursor") == met[0].strongest
    assert page.evaluate("review.mode") == met[0].mode
    assert page.evaluate("document.querySelector('#table-moments').open") is False
    assert "1 times" in page.text("#summary")


def test_cursor_of_a_chart_that_comes_into_sight(page: Any) -> None:
    """The cursor is at its time also in a chart that was out of sight when the view changed."""
    page.resize(1280, 400)
    page.evaluate("document.querySelector('#table-meetings tbody tr').click()")
    page.settle()
    page.evaluate("document.querySelector('#chart-margin').scrollIntoView()")
    page.evaluate("new Promise(done => setTimeout(done, 200))")
    left, width = page.evaluate(
        "(e => [parseFloat(e.style.left), e.parentElement.clientWidth])"
        "(document.querySelector('#chart-margin .cursor'))"
    )
    low, high = page.evaluate("review.view")
    time = page.evaluate("review.columns.time[review.cursor]")
    assert left / width == pytest.approx((time - low) / (high - low), abs=0.01)


def test_ticks_are_round_and_real(page: Any) -> None:
    """Labels of the time axis are round times since the first stamp on both sides of a gap."""
    labels = page.evaluate("review.ticks('margin')")
    assert labels[:2] == ["0:00", "0:05"]
    assert "15:10" in labels
    assert labels[-1] == "0:05"


def test_canvases_have_names_and_numbers(page: Any) -> None:
    """Each canvas of a chart has a name, and a table of its numbers opens."""
    unnamed = page.evaluate(
        "[...document.querySelectorAll('canvas:not([aria-hidden])')]"
        ".filter(c => !c.getAttribute('aria-label')).length"
    )
    assert unnamed == 0
    page.evaluate("document.querySelectorAll('.numbers').forEach(e => { e.open = true; })")
    page.settle()
    tables = page.evaluate(
        "[...document.querySelectorAll('.chart-row')]"
        ".map(e => e.querySelectorAll('.numbers tbody td').length)"
    )
    assert len(tables) == 7
    assert min(tables) >= 25


def test_next_goes_forward_from_the_cursor(page: Any, jumping: Path) -> None:
    """Next and Previous go to the moments beside the cursor, and rows can be sorted."""
    found = moments(read_log(jumping))
    page.click(page.place("#chart-peak .u-over", 0.01))
    page.key("n", "n")
    assert page.evaluate("review.cursor") == found[0].nearest
    page.key("n", "n")
    assert page.evaluate("review.cursor") == found[1].nearest
    page.key("p", "p")
    assert page.evaluate("review.cursor") == found[0].nearest
    page.evaluate("document.querySelector('#table-moments').open = true")
    head = "#table-moments th:nth-child(6) button"
    page.evaluate(f"document.querySelector('{head}').click()")
    cells = "[...document.querySelectorAll('#table-moments tbody td:nth-child(6)')]"
    shown = list(map(float, page.evaluate(f"{cells}.map(e => e.textContent)")))
    assert shown == sorted(shown)


def test_campbell_plot(page: Any, jumping: Path) -> None:
    """Each source has a plot with its orders and the bands of the modes below them."""
    log = read_log(jumping)
    titles = page.evaluate("[...document.querySelectorAll('#campbell svg')].map(e => e.ariaLabel)")
    assert len(titles) == len({one.source for one in log.excitations} & set(log.speeds)) == 2
    assert all("orders and 3 modes" in title for title in titles)
