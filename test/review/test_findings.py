# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The page begins with the answer, and its numbers are those of the log."""

import html
import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linkage_vibration.cli.main import main
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.judge import InputFault
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.prediction.severity import ResonanceState
from linkage_vibration.prediction.verdict import contributions, episodes
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.review.findings import (
    DOUBTFUL,
    all_counted,
    ending,
    first_sentence,
    log_levels,
    remedy,
    speeds_at_drive,
)
from linkage_vibration.review.log import Log, problems, read_log
from linkage_vibration.review.overview import drive_summary, overview_html
from linkage_vibration.review.review_page import page_of, review_page
from linkage_vibration.review.time_axis import time_axis
from linkage_vibration.support.resources import PAPER_MECHANISM, config_file
from test.support.drive import engine_and_pto_speed, hitch_duty_cycle
from test.support.random_resonances import START, Message, write_drive

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


def test_only_invalid_angles(write_log: Any, tmp_path: Path) -> None:
    """Warnings are not known if no angle was valid."""
    times = np.arange(50) / 100.0
    path = write_log(tmp_path / "nan.mcap", times, np.full(50, np.nan))
    log = read_log(path)
    assert "is not known, as each crank angle was invalid" in first_sentence(log)
    assert is_one_sentence(log)
    doubted = replace(log, faults=(InputFault("No reading is a number.", 0, False, []),))
    assert ["No reading is" in b"".join(page_of(each)).decode() for each in (log, doubted)] == [
        0,
        1,
    ]


def is_one_sentence(log: Log) -> bool:
    """Return whether the page of a log has its sentence, and no script and no table."""
    page = b"".join(page_of(log)).decode()
    return first_sentence(log) in html.unescape(page) and not re.search("<script|<table", page)


@pytest.mark.parametrize(
    ("name", "fits"), [("four_bar", False), pytest.param(None, True, marks=pytest.mark.nightly)]
)
def test_amplitudes_that_the_mechanism_lacks(
    name: str | None, fits: bool, tmp_path: Path, browser: Any
) -> None:
    """Shipped excitations act on a hitch on its tractor; without its places, none has a load."""
    settings = Parameters(mechanism_file=str(config_file(f"{name}.yaml")) if name else "")
    replay([config_file("drives/hitch_duty_cycle.mcap")], tmp_path / "log.mcap", settings)
    log = read_log(tmp_path / "log.mcap")
    assert [bool(each.load or each.terrain) for each in log.excitations] == [fits] * 13
    assert log_levels(log) is not None
    assert ("no excitation at work" in first_sentence(log)) != fits
    (tmp_path / "page.html").write_bytes(b"".join(page_of(log)))
    browser.open(tmp_path / "page.html")
    assert ("No load above zero is known" in browser.text("#table-sources")) != fits


@pytest.mark.parametrize("inside", [0, 1])
def test_only_angles_outside(write_log: Any, tmp_path: Path, inside: int) -> None:
    """The page has the angle and the range alone; with a single angle inside it has charts."""
    angles = np.radians([343.8] * 50)
    angles[:inside] = 2.0
    log = read_log(write_log(tmp_path / "outside.mcap", np.arange(50) / 100.0, angles))
    text = "A crank angle of 343.8 deg is outside 90 to 180 deg: check hitch_offset or hitch_sign."
    assert first_sentence(log).startswith(text) == is_one_sentence(log) == (not inside)


def test_part_of_a_total_is_marked(log: Log) -> None:
    """The load is a line where all sources are known, and dotted and hatched elsewhere."""
    assert log.drive is not None
    page, at = review_page(log), log.drive.resonances
    total = np.asarray(at.total_load_ratio, dtype=float)
    lost = ((at.states >= ResonanceState.NOTE) & np.isnan(at.load_ratios)).any(axis=1)
    part = (at.unknown_sources != 0) | np.isnan(total) | lost
    assert lost.any()  # orders without an amplitude, near a mode
    whole = np.isfinite(np.asarray(page.columns["load_known"]))
    np.testing.assert_array_equal(whole, ~part)
    dotted = np.isfinite(np.asarray(page.columns["load_part"]))
    np.testing.assert_array_equal(dotted, part & np.isfinite(total))
    [chart] = [each for each in page.content["charts"] if each["id"] == "load"]
    hatched = np.zeros(len(log.stamps), np.bool_)
    red = hatched.copy()
    for start, end, kind in chart["shades"]:
        flags = {"unknown": hatched, "above": red}[kind]
        flags |= (log.times >= start) & (log.times < end)
    above = total > at.load_ratio_limit
    np.testing.assert_array_equal(red[:-1], above[:-1])
    np.testing.assert_array_equal(hatched[:-1], (part & ~above)[:-1])
    keys = {each["label"]: each.get("hatched") for each in chart["key"]}
    assert keys["not known whether above the limit"] is True
    assert keys["above the limit, or tyres off the ground"] is False


@pytest.mark.parametrize(("step", "hatched"), [(3.0, 0), (3.5, 1)])
def test_readings_that_are_far_apart_are_hatched(
    write_log: Any, tmp_path: Path, step: float, hatched: int
) -> None:
    """A reading holds for at most 3 s, so the load is not known from then to the next one."""
    log = read_log(write_log(tmp_path / "sparse.mcap", step * np.arange(9), np.full(9, 2.0)))
    page = review_page(log)
    [chart] = [each for each in page.content["charts"] if each["id"] == "load"]
    late = [span for span in chart["shades"] if span[0] % step == pytest.approx(3.0)]
    assert late == [[step * k + 3.0, step * (k + 1), "unknown"] for k in range(8)] * hatched


def test_jump_of_the_clock(jumping: Path) -> None:
    """Both passes are kept apart, in the order in which they were written."""
    log = read_log(jumping)
    assert log.passes.tolist() == [2000]
    assert (np.diff(log.times) > 0.0).all()
    assert (np.diff(log.stamps)[[1999]] < 0).all()
    np.testing.assert_array_equal(log.stamps[:1000][:800], log.stamps[2000:2800])
    np.testing.assert_allclose(log.crank_angle[2000:2800] - log.crank_angle[:800], 0.02)
    actual = log.resonances
    assert actual is not None
    assert (actual.natural_frequency[2000:2100] != actual.natural_frequency[:100]).all()
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
    """The angle in the table is that of the crank without its whole turns."""
    assert log.table is not None
    turning = replace(log.table, alpha3=np.linspace(0.0, 2.0 * np.pi, len(log.table.alpha3)))
    known = np.isfinite(log.crank_angle)
    turned = np.where(known, log.crank_angle + 6.0 * np.pi, np.nan)
    around = replace(log, table=turning, crank_angle=turned)
    np.testing.assert_allclose(around.table_angle[known], log.crank_angle[known], atol=1e-9)


@pytest.fixture(scope="module")
def overview(drive: Path, jumping: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of two logs and a damaged one, with their overview and pages."""
    folder = tmp_path_factory.mktemp("logs")
    for path in (drive, jumping):
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "cut.mcap").write_bytes(drive.read_bytes()[:1000])
    assert main(["review", str(folder), "-o", str(folder / "all.html")]) == 3  # one is cut
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
    actual = {**drive_summary(log), "log": text, "sentence": text, "mode_names": [text] * 3}
    text = overview_html([(actual, "a b#.html")], [text])
    assert "<script>" not in text
    assert 'href="a%20b%23.html"' in text


def test_static_force_of_the_largest_load(log: Log) -> None:
    """The page names the static force in that pin, which the model computes at that angle."""
    cards = dict(review_page(log).content["provenance"]["rows"])
    assert log.drive is not None
    row = int(np.nanargmax(log.drive.resonances.total_load_ratio))
    model = LinkageModel(read_mechanism(config_file(PAPER_MECHANISM)))
    place = log.drive.resonances.total_load_place[row]
    forces = model.reference_forces(float(log.drive.angles[row]))
    force = float(forces[model.force_places.index(place)])
    assert cards["Largest load"].endswith(f"; the static force there is {1e-3 * force:.3g} kN")


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
    assert main(["review", str(drive), str(jumping), "--json"]) == 0
    first, second = json.loads(capsys.readouterr().out)["drives"]
    assert first["sentence"] == first_sentence(log)
    assert first["worst"]["load_ratio_factor"] is None
    assert first["predictions"] == len(log.stamps)
    assert (second["clock_jumps"], second["gaps"]) == (1, 1)
    assert first["mode_names"] == (list(log.table.mode_names) if log.table else [])
    assert log.drive is not None
    warnings = episodes(log.drive)
    assert (first["warnings"], len(first["excitations"])) == (len(warnings), 6)
    assert first["in_warning_s"] == pytest.approx(sum(each.duration for each in warnings), rel=1e-5)
    numbers = [first["worst"]["load_ratio"], first["in_warning_s"], first["duration_s"]]
    assert all(len(str(number)) < 9 for number in numbers)
    assert f"<td>{first['worst']['load_ratio']:.2g}</td>" in overview_html([(first, "a.html")], [])


def test_summary_names_a_log_that_is_cut(overview: Path, tmp_path: Path, capsys: Any) -> None:
    """Of three logs, two are printed and the third is named; without any, the command fails."""
    assert main(["review", str(overview), "--json"]) == 3
    output = capsys.readouterr()
    content = json.loads(output.out)
    assert [Path(each["log"]).name for each in content["drives"]] == ["drive.mcap", "jumping.mcap"]
    [failure] = content["failures"]
    assert failure["log"] == str(overview / "cut.mcap")
    assert "cut.mcap is damaged" in failure["error"]
    assert failure["error"] in output.err
    assert main(["review", str(overview / "cut.mcap"), "--json"]) == 1
    output = capsys.readouterr()
    assert "cut.mcap is damaged" in output.err
    assert output.out == ""


@pytest.mark.parametrize(
    ("unknown", "total", "state", "code", "said"),
    [
        (5, 0.1, 1, 0, ""),
        (6, 0.1, 1, 3, "limit for 94 % of the drive, less than 95 %"),
        (0, 0.3, 1, 0, ""),
        (0, 0.4, 2, 3, "above the limit for 1 s; warnings: 0 with 0 s"),
        (0, 0.4, 3, 3, "above the limit for 1 s; warnings: 1 with 1 s"),
    ],
)
def test_strict_summary(
    unknown: int, total: float, state: int, code: int, said: str, tmp_path: Path, capsys: Any
) -> None:
    """Warnings, loads above the limit, and less than 95 % known end with the code 3."""
    messages = [
        Message(
            START + 10**7 * k,
            2.0,
            state,
            (state,) * 4,
            (total / 2.0,) * 4,
            total,
            "engine 1",
            2 if k < unknown else 0,
            0.33,
        )
        for k in range(100)
    ]
    path = str(write_drive(tmp_path / "drive.mcap", messages))
    assert main(["review", path, "--json", "--strict"]) == code
    assert said in capsys.readouterr().err


def test_summary_without_loads(write_log: Any, tmp_path: Path) -> None:
    """Where nothing was assessed, all of the time is unknown, and durations are null, not 0."""
    times = np.arange(50) / 100.0
    for speeds, angle in ((False, 2.0), (True, np.nan)):
        path = write_log(tmp_path / "log.mcap", times, np.full(50, angle), speeds)
        values = drive_summary(read_log(path))
        for key in ("warnings", "in_warning_s", "above_limit_s", "below_limit_s"):
            assert values[key] is None
        assert values["unknown_s"] == pytest.approx(0.5, abs=0.011)
        assert values["known_share"] == 0.0


def test_speeds_at_a_drive(log: Log) -> None:
    """The ground speed is a magnitude in reverse, too; a negative speed of a shaft is not known."""
    before = np.array([-1.0])
    speeds = {Source.GROUND: (before, np.array([-2.0])), Source.PTO: (before, np.array([-540.0]))}
    actual = speeds_at_drive(replace(log, speeds=speeds))
    assert (actual[Source.GROUND] == 2.0).all()
    assert np.isnan(actual[Source.PTO]).all()


def test_what_ends_a_warning_does_end_it(log: Log) -> None:
    """At the angle and the speeds of the message, the limit holds at each value as it is written.

    So it does at the values that the messages state.
    """
    levels = log_levels(log)
    assert log.drive is not None
    assert levels is not None
    speed_times, *speeds = engine_and_pto_speed()
    checked, stale = 0, 0
    for row in np.flatnonzero(log.drive.resonances.state == ResonanceState.WARNING)[::20].tolist():
        at, angle = log.drive.resonances.message(row), float(log.drive.angles[row])
        latest = int(np.searchsorted(speed_times, log.drive.times[row] + 1e-9, "right")) - 1
        present = np.array([*(speed[latest] for speed in speeds), math.nan])
        place = int(at.speed_source) - 1

        def total(angle: float, speed: float, present: Any = present, place: int = place) -> float:
            changed = np.where(np.arange(3) == place, speed, present)
            assert levels is not None
            there = levels.at(np.array([angle]), changed[:, np.newaxis])
            return float(there.total_load_ratio[0])

        assert total(angle, present[place]) == pytest.approx(at.total_load_ratio, rel=1e-5)
        text = ending(log, row)
        if speed := re.search(r"speed of ([\d.]+) rpm", text):
            assert total(angle, float(speed[1])) <= 0.02
            checked += 1
        if height := re.search(r"angle of ([\d.]+) deg", text):
            assert total(np.deg2rad(float(height[1])), present[place]) <= 0.02
            checked += 1
        stale += total(angle, at.quiet_speed * 30.0 / math.pi) > 0.02
        stale += total(float(at.quiet_angle), present[place]) > 0.02
    assert checked > 40
    assert stale == 0
    unlike = replace(log, speeds={Source.ENGINE: log.speeds[Source.ENGINE]})
    assert log.drive.resonances.excitation[20] == "engine_shake 1.5"
    assert (ending(log, 20) != "", ending(unlike, 20)) == (True, "")
    times, values = log.speeds[Source.PTO]  # another PTO speed changes the total by over 0.1 %
    faster = replace(log, speeds=log.speeds | {Source.PTO: (times, 1.1 * values)})
    assert ending(faster, 20) == ""


def test_what_would_end_a_load(log: Log) -> None:
    """Above the limit the page names what ends that; below it nothing, and else it is not known."""
    assert log.drive is not None
    of, seen = log.drive.resonances, set[str]()
    for row in range(0, len(log.drive.times), 40):
        text, above = remedy(log, row), of.total_load_ratio[row] > of.load_ratio_limit[row]
        expected = "not needed, as nothing was above its limit"
        lost = np.isnan(of.load_ratios[row]) & (of.states[row] >= ResonanceState.NOTE)
        if of.unknown_sources[row] or np.isnan(of.total_load_ratio[row]) or lost.any():
            expected = "not known"
        if above and (words := ending(log, row)):
            expected = f"{words}; this is enough"
        if not above or ending(log, row):
            assert text.startswith(expected)
        seen.add(text[:6])
    assert {"not ne", "a PTO "} <= seen
    calm = int(np.flatnonzero((of.unknown_sources == 0) & (of.total_load_ratio < 0.01))[0])
    worst = int(np.nanargmax(of.total_load_ratio))
    lifted = MessageColumns(**vars(of) | {"off_ground_share": np.full(len(log.drive.times), 0.3)})
    off = replace(log, drive=replace(log.drive, resonances=lifted))
    assert remedy(log, calm).startswith("not needed")
    assert remedy(off, calm) == "no speed or height alone that is known"
    assert off.drive is not None
    assert [all_counted(each)[calm] for each in (log.drive, off.drive)] == [True, False]
    bare = remedy(replace(log, table=None), worst)
    assert bare == "not known, as the log does not hold the model"


def test_an_angle_that_leaves_a_load(log: Log) -> None:
    """The load at the angle as it is written says whether that is enough."""
    assert log.drive is not None
    of, speeds, levels, checked = log.drive.resonances, speeds_at_drive(log), log_levels(log), 0
    limits = np.full(len(log.drive.times), np.float32(0.005))
    low = MessageColumns(**vars(of) | {"load_ratio_limit": limits})
    low_log = replace(log, drive=replace(log.drive, resonances=low))
    for row in range(0, len(limits), 40):
        if "deg would leave" in (text := remedy(low_log, row)):
            assert levels is not None
            at = np.array([[speeds[s][row] if s in speeds else math.nan] for s in Source])
            angle = np.radians([float(text.split()[4])])
            left = levels.at(angle, at).total_load_ratio[0]
            assert ("not enough" in text) == (left > limits[row])
            assert float(text.split()[8].strip(";")) == pytest.approx(left, rel=0.051)
            checked += 1
    assert checked > 10


@pytest.fixture
def page(browser: Any, overview: Path) -> Iterator[Any]:
    """Return the browser with the page of the jumping log."""
    browser.problems.clear()
    browser.resize(1280, 900)
    browser.open(overview / "jumping.html")
    yield browser
    assert browser.problems == []


def test_page_begins_with_the_answer(page: Any, jumping: Path) -> None:
    """The beginning of the sentence comes first, and the cursor is at the worst moment."""
    log = read_log(jumping)
    sentence = first_sentence(log).removeprefix(DOUBTFUL)
    assert page.text("#answer").startswith(DOUBTFUL + sentence[: sentence.index(". ") + 1])
    assert page.text("#rest p") == sentence[sentence.index(". ") + 2 :]
    assert page.text("#inputs li") == log.input_faults[0]
    assert log.drive is not None
    rows = page.evaluate("[...document.querySelectorAll('#table-contributions tbody tr')].length")
    assert rows == len(log.drive.names)
    worst = contributions(log.drive)[0].worst
    assert page.evaluate("review.cursor") == log.drive.predictions[worst]
    assert page.evaluate("review.mode") == log.drive.resonances.mode[worst]
    assert page.evaluate("document.querySelector('#table-moments').open") is False
    assert "1 times" in page.text("#provenance")


def test_decimal_points_are_aligned(page: Any) -> None:
    """The points of load ratios stand below one another, whatever digits deviations leave."""
    page.evaluate("document.querySelector('#table-contributions').open = true")
    ends, digits = page.evaluate(
        "(cells => [cells.map(c => { const r = document.createRange(), text = c.firstChild;"
        " r.setStart(text, 0); r.setEnd(text, text.data.indexOf('.'));"
        " return r.getBoundingClientRect().right; }), cells.map(c => c.textContent.length)])"
        "([...document.querySelectorAll('#table-contributions td.number:nth-child(2)')]"
        ".filter(c => c.textContent.includes('.')))"
    )
    assert len({*digits}) > 1
    assert np.ptp(ends) < 0.5  # pixel


def test_cursor_of_a_chart_that_comes_into_sight(page: Any) -> None:
    """The cursor is at its time also in a chart that was out of sight when the view changed."""
    page.resize(1280, 400)
    page.evaluate("document.querySelector('#table-contributions tbody tr').click()")
    page.settle()
    page.evaluate("document.querySelector('#chart-angle').scrollIntoView()")
    page.evaluate("new Promise(done => setTimeout(done, 200))")
    left, width = page.evaluate(
        "(e => [parseFloat(e.style.left), e.parentElement.clientWidth])"
        "(document.querySelector('#chart-angle .cursor'))"
    )
    low, high = page.evaluate("review.view")
    time = page.evaluate("review.columns.time[review.cursor]")
    assert left / width == pytest.approx((time - low) / (high - low), abs=0.01)


def test_ticks_are_round_and_real(page: Any) -> None:
    """Labels of the time axis are round times since the first stamp on both sides of a gap."""
    labels = page.evaluate("review.ticks('load')")
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
    assert len(tables) == 3
    assert min(tables) >= 25


def test_next_goes_forward_from_the_cursor(page: Any, jumping: Path) -> None:
    """Next and Previous go to the moments beside the cursor, and rows can be sorted."""
    drive = read_log(jumping).drive
    assert drive is not None
    actual = drive.predictions[[each.worst for each in episodes(drive)]].tolist()
    page.click(page.place("#chart-modes .u-over", 0.01))
    actual = [row for row in actual if row > page.evaluate("review.cursor")]
    page.key("n", "n")
    assert page.evaluate("review.cursor") == actual[0]
    page.key("n", "n")
    assert page.evaluate("review.cursor") == actual[1]
    page.key("p", "p")
    assert page.evaluate("review.cursor") == actual[0]
    page.evaluate("document.querySelector('#table-moments').open = true")
    head = "#table-moments th:nth-child(6) button"
    page.evaluate(f"document.querySelector('{head}').click()")
    cells = "[...document.querySelectorAll('#table-moments tbody td:nth-child(6)')]"
    shown = list(map(float, page.evaluate(f"{cells}.map(e => e.textContent)")))
    assert shown == sorted(shown)
