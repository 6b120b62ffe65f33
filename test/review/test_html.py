# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The page is one file, its size is bounded, and no text of a log can become a script."""

import base64
import json
import re
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linkage_vibration.review.html import (
    _FOLDER,
    _SCRIPTS,
    MAX_SAMPLES,
    Page,
    _column,
    packed,
    page_parts,
    thinned,
)
from linkage_vibration.review.log import read_log
from linkage_vibration.review.review_page import review_page


def page_text(page: Page) -> str:
    """Return the text of a page."""
    return b"".join(page_parts(page)).decode()


def held(page: str) -> Any:
    """Return the data in a page."""
    [data] = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)
    return json.loads(data)


def unpacked(column: Any) -> Any:
    """Return the numbers of a packed array: its bytes are sums of differences, plane by plane."""
    kind = np.dtype(f"<{column['type']}")
    differences = np.frombuffer(zlib.decompress(base64.b64decode(column["deflate"])), np.uint8)
    planes = np.cumsum(differences.reshape(kind.itemsize, -1), axis=1, dtype=np.uint8)
    return np.frombuffer(planes.T.tobytes(), kind)


def test_page_needs_nothing_else(drive: Path) -> None:
    """No script, style or picture comes from elsewhere, and the page contains uPlot's licence."""
    page = page_text(review_page(read_log(drive)))
    assert not re.search(r"""(?:src|href)=["']?(?!data:,)\w""", page.split('id="data"')[0])
    assert "@import" not in page
    assert "fetch(" not in page
    assert "Copyright (c) 2022 Leon Sorokin" in page
    assert "{{" not in page


def test_page_holds_every_script() -> None:
    """Each script in the folder is part of the page once."""
    own = {path.stem for path in _FOLDER.glob("*.js")} - {"uPlot.iife.min"}
    assert len(_SCRIPTS) == len(own)
    assert set(_SCRIPTS) == own


def test_columns_are_the_log_s(drive: Path) -> None:
    """Times and angles are in the page exactly, and the rest as float32."""
    log = read_log(drive)
    data = held(page_text(review_page(log)))
    for name, expected in (
        ("time", log.times),
        ("crank_angle", log.crank_angle),
        ("f3", log.natural_frequencies[:, 2].astype(np.float32)),
        ("s1", log.frequency_stddevs[:, 0].astype(np.float32)),
        ("peak_magnitude", log.peak_magnitude.astype(np.float32)),
        ("status", log.status),
    ):
        np.testing.assert_array_equal(unpacked(data["columns"][name]), expected, name)
    assert data["n"] == len(log.stamps)
    [gap] = [shade for shade in data["shades"] if shade[2] == "gap"]
    assert gap[:2] == [5.0, 6.0]
    ranges = [shade[:2] for shade in data["shades"] if shade[2] == "range"]
    np.testing.assert_allclose(ranges, [(3.0, 3.01), (12.0, 12.5)])


def test_text_of_a_log_stays_text(drive: Path) -> None:
    """Names and parameters that look like HTML neither end a script nor make an element."""
    log = replace(read_log(drive), parameters_text="</script><b>", path=Path("<i>.mcap"))
    page = page_text(review_page(log))
    assert "</script><b>" not in page
    assert "<i>.mcap" not in page
    assert held(page)["provenance"]["files"][0]["text"] == "</script><b>"


def test_long_logs_are_thinned_to_their_extremes() -> None:
    """The lowest and the highest value of every stretch are kept, and all given samples."""
    random = np.random.default_rng(1)
    a, b = random.normal(size=(2, 10_007))
    a[500:900] = np.nan
    kept = thinned([a, b], np.array([777]), limit=1000)
    assert len(kept) <= 1003
    assert 777 in kept
    assert kept[0] == 0
    assert kept[-1] == 10_006
    length = -(-10_007 // 250)
    for values in (a, b):
        for start in range(0, 10_007, length):
            stretch, own = values[start : start + length], kept[(kept >= start)]
            own = own[own < start + length]
            if np.isfinite(stretch).any():
                assert np.nanmin(stretch) == np.nanmin(values[own])
                assert np.nanmax(stretch) == np.nanmax(values[own])
    np.testing.assert_array_equal(thinned([a], np.array([], int), limit=10_007), np.arange(10_007))


def test_size_is_bounded() -> None:
    """A page with 3 modes and 13 excitations has less than 50 MB, even of random numbers."""
    doubles, singles, bytes_ = 3, 2 * 3 + 3 + 7, 5 + 13  # columns of each kind
    sample = 8 * doubles + 4 * singles + bytes_
    assert MAX_SAMPLES * sample * 4 / 3 < 50e6


@pytest.mark.parametrize("kind", ["f8", "f4", "u1"])
def test_packed(kind: str) -> None:
    """Arrays are packed as little-endian numbers, which the page's script expects."""
    values = np.array([0, 255, 1, 128, 0]).astype(f">{kind}" if kind != "u1" else kind)
    actual = packed(values)
    assert actual["type"] == kind
    np.testing.assert_array_equal(unpacked(actual), values)
    assert unpacked(packed(values[:0])).shape == (0,)


def test_steady_numbers_take_less_than_a_byte() -> None:
    """A quantity that is measured in steps, and stays for some time, takes little of a page."""
    angles = np.pi / 2**13 * np.round(600.0 * np.sin(np.arange(100_000) / 3000.0))
    assert len(packed(angles)["deflate"]) < len(angles)


def test_column_of_infinities() -> None:
    """An angle that is always infinite is packed, as JSON has no infinity."""
    assert _column(np.full(3, np.inf)) == packed(np.full(3, np.inf))
    assert _column(np.full(3, 2.0)) == {"type": "f8", "constant": 2.0}
    assert _column(np.full(3, np.nan)) == {"type": "f8", "constant": None}
