# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The map of height and ground speed of a drive, and the sentence about its worst moment."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from linkage_vibration.cli.main import main
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.prediction.verdict import worst_message
from linkage_vibration.review.advice_map import advice_map
from linkage_vibration.review.findings import first_sentence, log_levels
from linkage_vibration.review.log import Log, read_log
from linkage_vibration.review.overview import drive_summary
from linkage_vibration.support.resources import DEFAULT_EXCITATIONS, config_file
from test.support.road import write_road


@pytest.fixture(scope="module")
def road(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of a drive on an even road, on which the runout of the tyres is resonant."""
    folder = tmp_path_factory.mktemp("road")
    write_road(folder / "road.mcap")
    log, limits = folder / "log.mcap", {"warning_load_ratio": 0.15, "note_load_ratio": 0.05}
    replay(folder / "road.mcap", log, Parameters(**limits, excitation_file=even(folder)))
    return log


def even(folder: Path) -> str:
    """Return the path of the default excitations without the ground."""
    path, orders = (
        folder / "even.yaml",
        yaml.safe_load(config_file(DEFAULT_EXCITATIONS).read_text()),
    )
    del orders["ground"]
    path.write_text(yaml.safe_dump(orders))
    return str(path)


@pytest.fixture(scope="module")
def log(road: Path) -> Log:
    """Return that log."""
    return read_log(road)


def test_map_and_sentence_are_about_the_worst_moment(log: Log) -> None:
    """The best height is that of a search of the same heights, and the sentence names it."""
    shown, levels = advice_map(log), log_levels(log)
    assert shown is not None
    assert levels is not None
    assert log.drive is not None
    worst = worst_message(log.drive)
    speed = shown["now"][0] / 3.6
    assert shown["now"][1] == pytest.approx(np.degrees(log.drive.angles[worst]), abs=1e-3)

    def load(angle: float) -> float:
        speeds = np.array([[1800.0], [np.nan], [speed]])
        return float(levels.at(np.array([angle]), speeds).total_load_ratio[0])

    angles = np.radians(np.linspace(90.0, 180.0, 61))
    loads = [load(angle) for angle in angles.tolist()]
    assert shown["best"][1] == pytest.approx(np.degrees(angles[int(np.argmin(loads))]), abs=1e-3)
    assert max(speed for speed, _ in shown["drive"]) == pytest.approx(36.0)
    assert shown["speeds"][-1] == pytest.approx(1.15 * 36.0)
    share = min(loads) / load(float(log.drive.angles[worst]))
    assert 0.45 < share < 0.55
    sentence = first_sentence(log)
    carried = f"Carried at {shown['best'][1]:.0f} deg instead of 165 deg at {3.6 * speed:.0f} km/h"
    assert f"{carried} it would have been loaded half as much (" in sentence
    assert drive_summary(log)["sentence"] == sentence


def test_a_drive_without_ground_speed_has_no_map(drive: Path) -> None:
    """Nothing is drawn over a speed that nobody knows."""
    assert advice_map(read_log(drive)) is None


def test_places_that_are_not_known_interrupt_the_drive(tmp_path: Path) -> None:
    """An infinite angle and a speed that is NaN are no places, and the page is written."""
    bag, log, page = (tmp_path / name for name in ("bag.mcap", "log.mcap", "page.html"))
    write_road(bag, infinite=range(200, 240), unknown=range(300, 340))
    replay(bag, log, Parameters(resonance_rate=0.0, excitation_file=even(tmp_path)))
    assert main(["review", str(log), "-o", str(page)]) == 0
    assert page.exists()
    shown = advice_map(read_log(log))
    assert shown is not None
    assert [place is None for place in shown["drive"]] == [
        200 <= k < 240 or 300 <= k < 340 for k in range(800)
    ]


def test_page_draws_the_map(road: Path, tmp_path: Path, browser: Any) -> None:
    """The page has the map with the drive, and reads its values at the pointer."""
    page = tmp_path / "page.html"
    assert main(["review", str(road), "-o", str(page)]) == 0
    browser.problems.clear()
    browser.resize(1280, 900)
    browser.open(page)
    assert browser.evaluate("document.querySelectorAll('#advice svg image').length") == 2
    assert browser.evaluate("document.querySelectorAll('#advice svg circle').length") == 2
    browser.evaluate(
        "(() => { const drawn = document.querySelector('#advice svg');"
        "drawn.scrollIntoView(); const box = drawn.getBoundingClientRect();"
        "drawn.dispatchEvent(new PointerEvent('pointermove',"
        "{ clientX: box.left + .4 * box.width, clientY: box.top + .4 * box.height })); })()"
    )
    text = browser.evaluate("document.querySelector('#advice .note').textContent")
    assert "km/h: load ratio 0." in text
    assert browser.problems == []
