# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a log works in a browser with mouse, keys and touch."""

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linkage_vibration.cli.main import main
from linkage_vibration.messages.definitions import message_definition
from linkage_vibration.prediction.judge import InputFault
from linkage_vibration.prediction.verdict import Drive, durations, episodes
from linkage_vibration.review.findings import DOUBTFUL
from linkage_vibration.review.log import Log, read_log
from linkage_vibration.review.overview import drive_summary
from linkage_vibration.review.review_page import STATES, page_of, review_page

SHIFT = 8


@pytest.fixture(scope="module")
def log(drive: Path) -> Log:
    """Return the log that the page shows."""
    return read_log(drive)


@pytest.fixture(scope="module")
def file(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the page, written by the command."""
    path = tmp_path_factory.mktemp("review") / "drive.html"
    assert main(["review", str(drive), "-o", str(path)]) == 0
    return path


@pytest.fixture
def page(browser: Any, file: Path) -> Iterator[Any]:
    """Return the browser with the page loaded, and check for errors after the test."""
    browser.problems.clear()
    browser.resize(1280, 900)
    browser.open(file)
    yield browser
    assert browser.problems == []


def view(page: Any) -> list[float]:
    """Return the start and the end of the page's view, s."""
    return list(map(float, page.evaluate("review.view")))


def test_browser_that_cannot_unpack(browser: Any, file: Path) -> None:
    """A browser without decompression gets a sentence that names browsers that have it."""
    browser.problems.clear()
    source = "delete window.DecompressionStream"
    script = browser.send("Page.addScriptToEvaluateOnNewDocument", source=source)
    browser.open(file)
    browser.send("Page.removeScriptToEvaluateOnNewDocument", **script)
    assert "cannot unpack the numbers of this page; open it in" in browser.text("#subtitle")
    assert browser.problems == []


def test_charts_out_of_sight_follow(page: Any) -> None:
    """A chart below the window is drawn, too, once the page is open, and has a cursor."""
    assert page.place("#chart-angle .u-over")[0] > 0.0
    page.evaluate("scrollTo(0, 0)")
    assert page.evaluate("document.querySelector('#chart-angle').getBoundingClientRect().top") > 900
    lines = "document.querySelectorAll('.chart .cursor').length"
    assert page.evaluate(lines) == page.evaluate("document.querySelectorAll('.chart').length")


def test_command_writes_files(drive: Path, tmp_path: Path, capsys: Any) -> None:
    """The page is written beside the log by default, with a picture and a table."""
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(drive.read_bytes())
    options = ["--png", str(tmp_path / "a.png"), "--csv", str(tmp_path / "a.csv")]
    assert main(["review", str(copy), *options]) == 0
    assert capsys.readouterr().out.startswith(f"Written: {tmp_path / 'copy.html'}, ")
    assert {p.name for p in tmp_path.iterdir()} == {"copy.mcap", "copy.html", "a.png", "a.csv"}


def test_page_shows_the_drive(page: Any, log: Log) -> None:
    """The page has charts of the load, of all modes and of the angle, and lists all moments."""
    rows = page.evaluate("[...document.querySelectorAll('.chart')].map(e => e.id)")
    assert rows == ["chart-load", "chart-modes", "chart-angle"]
    values = page.evaluate("document.querySelectorAll('#table-moments tbody tr').length")
    assert log.drive is not None
    assert values == len(episodes(log.drive)) > 3
    assert log.table_id in page.text("#provenance")


def test_first_screen_answers(page: Any, log: Log) -> None:
    """At 1280 x 900 it has a short verdict, the load with its limit, and up to three sources."""
    answer = page.text("#answer").removeprefix(DOUBTFUL)
    assert len(re.split(r"(?<=\.) (?=[A-Z])", answer)) <= 2
    assert log.drive is not None
    percent = math.floor(100.0 * durations(log.drive).known_share)
    assert f" {percent} %" in answer
    bottom = "document.querySelector('#table-sources').getBoundingClientRect().bottom"
    assert page.evaluate(f"(scrollTo(0, 0), {bottom})") <= 900
    assert page.evaluate("review.scale('load')")[1] > 0.02  # the limit in the parameters
    lines = "[...document.querySelectorAll('#table-sources tbody tr')].map(e => e.innerText)"
    rows = page.evaluate(lines)
    assert rows[0].startswith("pto shaft, ")
    assert 1 <= len(rows) <= 3
    heads = page.evaluate(
        "[...document.querySelectorAll('#table-sources th')].map(e => e.innerText)"
    )
    assert heads == ["source", "load ratio [1]", "largest at [s]", "what would end it"]


def test_labels_of_axes_are_exact(page: Any) -> None:
    """The labels of each axis of values are its values, also for steps as 0.0025."""
    for chart in ("load", "modes", "angle"):
        labels, values = page.evaluate(f"review.labels('{chart}')")
        pairs = [(float(a), b) for a, b in zip(labels, values, strict=True) if a is not None]
        assert len(pairs) > 1
        for shown, exact in pairs:
            assert shown == pytest.approx(exact, rel=1e-9, abs=1e-15)


def test_dark_mode_follows_the_browser(page: Any) -> None:
    """The page is inverted where the browser asks for dark colours, and not where it does not."""
    filters = "getComputedStyle(document.body).filter"
    for scheme, dark in (("dark", True), ("light", False)):
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        page.send("Emulation.setEmulatedMedia", features=features)
        assert ("invert" in page.evaluate(filters)) == dark


def test_hover_reads_the_log_s_numbers(page: Any, log: Log) -> None:
    """The page shows the numbers of the prediction nearest to the mouse, as in the log."""
    for share in (0.1, 0.3, 0.8):
        page.hover(page.place("#chart-modes .u-over", share))
        i = page.evaluate("review.cursor")
        assert log.times[i] == pytest.approx(share * log.times[-1], abs=0.03)
        for mode in range(3):
            shown = float(page.text(f"#read-f{mode + 1}").split()[0])
            text, spread = page.text(f"#read-f{mode + 1}").removesuffix(" Hz").split(" ± ")
            by = 2.0 * log.frequency_stddevs[i, mode]
            places = len(text.partition(".")[2])
            assert shown == round(float(log.natural_frequencies[i, mode]), places)
            assert 10.0 <= round(by * 10.0**places) <= 100.0  # two digits of the deviation
            assert float(spread) == pytest.approx(by, abs=0.51 * 10.0**-places)
            held = page.evaluate(f"review.columns.f{mode + 1}[{i}]")
            assert held == np.float32(log.natural_frequencies[i, mode])
        shown = float(page.text("#read-crank_angle").split()[0])
        assert shown == pytest.approx(np.rad2deg(log.crank_angle[i]), abs=5.1e-3)


def test_click_keeps_the_cursor(page: Any) -> None:
    """The cursor returns to the clicked sample when the mouse leaves the chart."""
    page.click(page.place("#chart-modes .u-over", 0.6))
    kept = page.evaluate("review.cursor")
    page.hover(page.place("#chart-modes .u-over", 0.2))
    assert page.evaluate("review.cursor") != kept
    page.hover(page.place("h1"))
    assert page.evaluate("review.cursor") == kept


def test_link_to_a_moment(page: Any, file: Path, log: Log) -> None:
    """A click puts its time into the address, and a page with a time there opens at it."""
    page.click(page.place("#chart-modes .u-over", 0.6))
    kept = page.evaluate("review.cursor")
    address = page.evaluate("location.href")
    assert address.endswith(f"#t={log.times[kept]:.3f}")
    page.evaluate("location.hash = '#t=3.21'")
    page.settle()
    assert page.evaluate("review.cursor") == np.argmin(np.abs(log.times - 3.21))
    page.evaluate("location.hash = '#t=1e9'")
    page.settle()
    assert page.evaluate("review.cursor") == np.argmin(np.abs(log.times - 3.21))
    page.open(file, address[address.index("#") :])
    assert page.evaluate("review.cursor") == kept


def test_drag_zooms_and_pans(page: Any, log: Log) -> None:
    """A drag zooms in, a drag with Shift moves the view, and a double-click shows everything."""
    whole = view(page)
    assert whole == [0.0, log.times[-1]]
    start, end = page.place("#chart-modes .u-over", 0.25), page.place("#chart-modes .u-over", 0.5)
    page.drag(start, end)
    np.testing.assert_allclose(view(page), [0.25 * whole[1], 0.5 * whole[1]], atol=0.05)
    page.drag(end, start, SHIFT)
    np.testing.assert_allclose(view(page), [0.3125 * whole[1], 0.5625 * whole[1]], atol=0.05)
    page.click(start, count=2)
    assert view(page) == whole


def test_wheel_and_strip(page: Any, log: Log) -> None:
    """Ctrl and the wheel zoom about the mouse; the window in the strip is drawn and dragged."""
    at = page.place("#chart-modes .u-over", 0.5)
    page.mouse("mouseWheel", at, deltaX=0, deltaY=-200, modifiers=2)
    page.settle()
    low, high = view(page)
    assert high - low < 0.6 * log.times[-1]
    assert low + high == pytest.approx(log.times[-1], abs=0.1)
    page.key("0", "0")
    page.drag(page.place("#overview .u-over", 0.5), page.place("#overview .u-over", 0.75))
    np.testing.assert_allclose(view(page), 0.01 * 2000 * np.array([0.5, 0.75]), atol=0.1)
    page.drag(page.place("#overview .u-over", 0.6), page.place("#overview .u-over", 0.35))
    np.testing.assert_allclose(view(page), 0.01 * 2000 * np.array([0.25, 0.5]), atol=0.1)


def test_moments_are_shown_on_demand(page: Any, log: Log) -> None:
    """A click on a row of the list sets cursor and mode; n and p go to the rows beside it."""
    drive = log.drive
    assert isinstance(drive, Drive)
    warnings = episodes(drive)
    messages = [each.worst for each in warnings]
    actual = drive.predictions[messages].tolist()
    page.evaluate("document.querySelector('#table-moments').open = true")
    page.click(page.place("#table-moments tbody tr:nth-child(3)"))
    assert page.evaluate("review.cursor") == actual[2]
    assert page.evaluate("review.mode") == drive.resonances.mode[messages[2]]
    low, high = view(page)
    assert low <= log.times[actual[2]] <= high
    assert high - low <= max(4.0 * warnings[2].duration, 2.0) + 0.01
    page.key("n", "n")
    assert page.evaluate("review.cursor") == actual[3]
    page.key("p", "p")
    assert page.evaluate("review.cursor") == actual[2]
    assert page.text("#read-excitation") == drive.resonances.excitation[messages[2]]


def test_keys(page: Any, log: Log) -> None:
    """Arrows move the cursor, + and - zoom about it, digits choose a mode, m stops the motion."""
    page.click(page.place("#chart-modes .u-over", 0.5))
    i = page.evaluate("review.cursor")
    page.key("ArrowRight", modifiers=SHIFT)
    assert page.evaluate("review.cursor") == i + 1
    page.key("ArrowLeft")
    assert page.evaluate("review.cursor") < i
    page.key("+", "+")
    low, high = view(page)
    assert high - low == pytest.approx(log.times[-1] / 2.0)
    page.key("-", "-")
    assert view(page) == [0.0, log.times[-1]]
    page.key("3", "3")
    assert page.evaluate("review.mode") == 2
    assert page.evaluate("document.querySelector('#mode-3').ariaChecked") == "true"
    page.key("m", "m")
    assert page.text("#move") == "Start the motion"
    page.key("ArrowRight")
    assert "Mode 2" in page.text("#spoken")


def test_modes_by_keyboard_alone(page: Any) -> None:
    """The modes are one stop of the Tab key, and arrow keys choose among them."""
    page.key("1", "1")
    page.evaluate("document.querySelector('#mode-1').focus()")
    page.key("ArrowRight")
    assert page.evaluate("document.activeElement.id") == "mode-2"
    assert page.evaluate("review.mode") == 1


def test_linkage_is_drawn_and_moves(page: Any, log: Log) -> None:
    """The linkage is at its position, moves in the mode, and is hidden without a prediction."""
    page.evaluate("document.querySelector('#linkage').scrollIntoView()")
    lines = "[...document.querySelectorAll('#linkage polyline')].map(e => e.getAttribute('points'))"
    before = page.evaluate(lines)
    n = len(before) // 2
    for _ in range(100):  # A busy machine may draw no frame for a while; 10 s are enough for any.
        page.evaluate("new Promise(done => setTimeout(done, 100))")
        after = page.evaluate(lines)
        if before[n:] != after[n:]:
            break
    assert before[:n] == after[:n]
    assert before[n:] != after[n:]
    ends = [line.split()[0] for line in before[:n]]
    assert "0.0000,0.0000" in ends  # P1, on the ground at the origin
    page.hover(page.place("#chart-modes .u-over", 12.25 / log.times[-1]))
    assert page.text("#linkage-caption") == "No prediction at 185.00°."
    assert page.text("#read-status") == "out of range"
    assert page.text("#read-f1") == "no value"


def test_lines_keep_their_extremes(page: Any, log: Log) -> None:
    """The drawn line reaches the lowest and the highest value, also when it is decimated."""
    page.resize(500, 900)
    page.evaluate("new Promise(done => setTimeout(done, 100))")
    shown = page.evaluate("review.drawn('modes', 4)")
    assert len(shown) < len(log.stamps)
    known = [value for value in shown if value is not None]
    assert min(known) == np.float32(np.nanmin(log.natural_frequencies[:, 1]))
    assert max(known) == np.float32(np.nanmax(log.natural_frequencies[:, 1]))
    assert None in shown


def test_phone(page: Any, tmp_path: Path) -> None:
    """At 380 px, nothing is wider than the screen, and a finger on a chart moves the cursor."""
    page.resize(380, 800, mobile=True)
    page.evaluate("new Promise(done => setTimeout(done, 100))")
    assert page.evaluate("document.documentElement.scrollWidth") == 380
    page.evaluate(
        "document.querySelectorAll('#modes button').forEach(b => { b.textContent += ' (link)'; })"
    )
    assert page.evaluate("document.documentElement.scrollWidth") == 380
    x, y = page.place("#chart-modes .u-over", 0.3)
    page.send("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
    page.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    page.settle()
    assert page.evaluate("review.columns.time[review.cursor]") == pytest.approx(0.3 * 20.0, abs=0.3)
    assert page.text("#brief").count("Hz") == 3
    page.screenshot(tmp_path / "phone.png", whole=True)
    assert (tmp_path / "phone.png").stat().st_size > 50_000


def test_print(page: Any, tmp_path: Path) -> None:
    """The page prints on a few sheets, and has its former width afterwards."""
    width = page.evaluate("document.querySelector('#chart-modes canvas').clientWidth")
    page.pdf(tmp_path / "page.pdf")
    data = (tmp_path / "page.pdf").read_bytes()
    assert data.startswith(b"%PDF")
    assert 2 <= data.count(b"/Type /Page\n") <= 8
    page.settle()
    assert page.evaluate("document.querySelector('#chart-modes canvas').clientWidth") == width


def test_bare_log(browser: Any, write_log: Any, tmp_path: Path) -> None:
    """A log without provenance gives a page without linkage, load and tables, and with a point."""
    log = write_log(tmp_path / "bare.mcap", [0.0], [2.0], False, False)
    assert main(["review", str(log)]) == 0
    browser.problems.clear()
    browser.open(tmp_path / "bare.html")
    assert browser.problems == []
    assert browser.evaluate("document.querySelector('#linkage-section').hidden") is True
    assert browser.evaluate("document.querySelectorAll('#chart-load, .table').length") == 0
    assert browser.text("#first-chart h3").startswith("Natural frequencies")
    assert dark_pixels(browser) > 5
    assert "does not hold the table" in browser.text("#provenance")


def dark_pixels(page: Any) -> int:
    """Return how many pixels of the chart of the crank angle have the colour of its line."""
    return int(
        page.evaluate(
            "(([c, o]) => c.getContext('2d').getImageData(o.offsetLeft, o.offsetTop, "
            "o.clientWidth, o.clientHeight).data.filter((v, i, d) => i % 4 === 0 && v < 64 "
            "&& d[i + 3] > 99).length)(['canvas', '.u-over'].map(e => "
            "document.querySelector('#chart-angle ' + e)))"
        )
    )


@pytest.mark.parametrize(
    ("hertz", "shown", "not_shown"),
    [([220.0, 400.0, 560.0], "200 300 400 500 600", "250"), ([5.95] * 3, "5.5 5.8 6 6.5", "5.55")],
)
def test_axis_of_frequencies_has_round_numbers(
    browser: Any, log: Log, tmp_path: Path, hertz: list[float], shown: str, not_shown: str
) -> None:
    """A logarithmic axis has labels also above 10 Hz, and where one round number is in sight."""
    same = np.full_like(log.natural_frequencies, hertz)
    page = page_of(replace(log, natural_frequencies=same, frequency_stddevs=0.0 * same))
    (tmp_path / "page.html").write_bytes(b"".join(page))
    browser.open(tmp_path / "page.html")
    labels = browser.evaluate("review.labels('modes')")[0]
    assert set(shown.split()) <= set(labels)
    assert not_shown not in labels


def test_words_of_states_are_those_of_the_message() -> None:
    """The page names a state as ``LoadState`` does: 0 is unknown, and only 1 is clear."""
    definition = message_definition("linkage_vibration_interfaces/msg/LoadState")
    named = re.findall(r"^uint8 STATE_(\w+) = (\d)$", definition, re.MULTILINE)
    assert [(name.lower(), int(value)) for name, value in named] == [
        (state, value) for value, state in enumerate(STATES)
    ]


@pytest.mark.parametrize("faults", [[], ["All stamps are zero."]])
def test_faults_of_the_inputs_are_named(log: Log, faults: list[str]) -> None:
    """The page and the summary have the sentences that the log has."""
    doubted = replace(log, faults=tuple(InputFault(text, 0, False, []) for text in faults))
    assert review_page(doubted).content["inputs"] == faults
    assert drive_summary(doubted)["input_faults"] == faults
