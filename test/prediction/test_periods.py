# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The times of readings whose stamps move or not, and the periods that they fall into."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linkage_vibration.prediction.periods import Periods, Stamps

MS = 1_000_000  # ns
START = 1_700_000_000_000 * MS  # of the receipts


def by_receipt(stamps: list[int]) -> list[bool]:
    """Return at which of readings with these stamps the receipt counts."""
    source = Stamps()
    return [source.time(stamp, START + k)[1] for k, stamp in enumerate(stamps)]


@pytest.mark.parametrize(
    ("stamps", "expected"),
    [
        ([5, 6, 7, 8], [False] * 4),  # they move
        ([8, 7, 6, 9], [False] * 4),  # also backwards, as where a bag is played in a loop
        ([0, 0, 0], [True] * 3),
        ([5, 5, 5, 5], [False, True, True, True]),  # the first one may be right
        ([5, 5, 6, 7, 8], [False, True, True, False, False]),  # two in turn have moved
        ([5, 5, 6, 6, 7, 7], [False, True, True, True, True, True]),  # each comes twice
        ([5, 6, 0, 7, 8], [False, False, True, True, False]),
    ],
)
def test_when_stamps_move(stamps: list[int], expected: list[bool]) -> None:
    """The receipt counts at a stamp of 0 and at a repeated one, until two in turn have moved."""
    assert by_receipt(stamps) == expected


@given(st.lists(st.integers(0, 3), max_size=60), st.integers(1, 20))
def test_times_of_many_are_those_of_each(stamps: list[int], size: int) -> None:
    """Where a block of a bag ends changes no time."""
    one, many = Stamps(), Stamps()
    receipts = [START + 10 * k for k in range(len(stamps))]
    expected = [one.time(*pair) for pair in zip(stamps, receipts, strict=True)]
    actual = []
    for start in range(0, len(stamps), size):
        rows = slice(start, start + size)
        times, received = many.times(np.array(stamps[rows]), np.array(receipts[rows]))
        actual += list(zip(times.tolist(), received.tolist(), strict=True))
    assert actual == expected


@pytest.mark.parametrize(
    "stamps",
    [[0] * 300, [7 * MS] * 300, [(k // 10) * 100 * MS for k in range(300)]],
    ids=["zero", "frozen", "ten with each stamp"],
)
def test_readings_at_100_hz_are_assessed_at_50_hz(stamps: list[int]) -> None:
    """In 3 s there are 150 periods of 20 ms, by the receipts of readings whose stamps stand.

    One more may be due where the stamps had counted before.
    """
    source, periods = Stamps(), Periods(50.0)
    receipts = [START + 10 * MS * k for k in range(300)]
    times = [source.time(*pair)[0] for pair in zip(stamps, receipts, strict=True)]
    due = sum(periods.is_due(time) for time in times)
    assert due in (150, 151)


@given(st.lists(st.integers(0, 40), max_size=60), st.integers(1, 20))
def test_what_is_due_of_many_is_what_is_due_of_each(times: list[int], size: int) -> None:
    """Where a block of a bag ends makes no message due, nor hides one, at 50 Hz."""
    one, many = Periods(50.0), Periods(50.0)
    stamps = START + 5 * MS * np.array(times, int)
    expected = [one.is_due(time) for time in stamps.tolist()]
    blocks = [many.due(stamps[k : k + size]).tolist() for k in range(0, len(stamps), size)]
    assert [each for block in blocks for each in block] == expected
