# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Samples of an even clock keep their places where stamps are shared or coarse, and only there.

The true times are those by which each test makes its stamps.
"""

import numpy as np
import pytest

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.readers.stamps import even_samples

STEP, N = 0.0025, 8000
TRUE = 1000.0 + STEP * np.arange(N)
SIGNALS = np.random.default_rng(0).normal(size=(N, 2))


class StampError(LinkageVibrationError):
    """Stamps were refused."""


def taken(stamps: FloatArray) -> FloatArray:
    """Return when samples of these stamps were taken, of which none may be dropped."""
    times, signals = even_samples("imu.csv", stamps, SIGNALS[: len(stamps)], StampError)
    np.testing.assert_array_equal(signals, SIGNALS[: len(stamps)])
    return times


def in_batches(size: float, vary: int, *, last: bool) -> FloatArray:
    """Return the true times of the first or last samples of batches, whose sizes may vary."""
    random = np.random.default_rng(1)
    sizes = np.maximum(size + random.integers(-vary, vary + 1, N), 1).astype(int)
    number = np.repeat(np.arange(N), sizes)[:N]
    firsts = np.flatnonzero(np.diff(number, prepend=-1))
    lasts = np.append(firsts[1:] - 1, N - 1)
    return np.asarray(TRUE[(lasts if last else firsts)[number]])


@pytest.mark.parametrize(
    ("stamps", "offset"),
    [
        (in_batches(2, 0, last=True), 0.0),
        (in_batches(8, 0, last=True), 0.0),
        (in_batches(8, 0, last=False), -7.0),  # The last sample counts as taken at the stamp.
        (in_batches(8, 5, last=True), 0.0),
        (in_batches(8, 5, last=False), 0.0),
        (in_batches(400, 0, last=True), 0.0),
        (np.round(TRUE, 2), 1.5),
        (np.floor(1e3 * TRUE + 1e-6) / 1e3, -0.1),
        (np.round(TRUE, 3), 0.0),
    ],
)
def test_samples_in_batches_or_with_coarse_stamps(stamps: FloatArray, offset: float) -> None:
    """All of them are as even as they were taken, up to an offset, in steps, of them all."""
    np.testing.assert_allclose((taken(stamps) - TRUE) / STEP, offset, atol=0.06)


@pytest.mark.parametrize("hertz", [111.0, 208.0, 640.0, 998.0, 1002.0])
def test_rates_that_fit_no_resolution(hertz: float) -> None:
    """Stamps in ms of other rates are those of an even clock, too, with or without shared ones."""
    true = np.arange(N) / hertz
    away = taken(np.round(true, 3)) - true
    assert np.ptp(away - away.mean()) < (2e-4 if hertz != 998.0 else 1.001e-3)


@pytest.mark.parametrize(
    ("hertz", "share"), [(208.0, 1e-4), (208.0, 0.05), (400.0, 1e-4), (400.0, 0.05), (640.0, 1e-4)]
)
def test_lost_samples_of_rounded_stamps(hertz: float, share: float) -> None:
    """A longer step shows which samples are lost, so that those beside them keep their places."""
    true = np.arange(N)[np.random.default_rng(4).random(N) >= share] / hertz
    assert len(true) < N
    np.testing.assert_allclose(taken(np.round(true, 3)), true, atol=1e-4)


@pytest.mark.parametrize(("apart", "even"), [(0.15, True), (0.25, False)])
def test_batches_with_stamps_of_receipt(apart: float, even: bool) -> None:
    """Nine samples that are received a seventh of a step apart are a batch; a quarter is none."""
    batch, place = np.divmod(np.arange(N), 5)
    stamps = STEP * (5 * batch + apart * place)
    assert (np.ptp(np.diff(taken(stamps))) < 1e-9) == even
    assert even or (taken(stamps) == stamps).all()


@pytest.mark.parametrize(("pairs", "even"), [(0.2, False), (0.4, True)])
def test_few_samples_close_together_are_no_batches(pairs: float, even: bool) -> None:
    """A fifth of the samples right after another is jitter; with two fifths they are batches."""
    stamps = TRUE - TRUE[0]
    late = np.flatnonzero(np.arange(N - 1) % round(1.0 / pairs + 0.1) == 0)
    stamps[late] = stamps[late + 1] - 0.1 * STEP
    assert (not (taken(stamps) == stamps).all()) == even


@pytest.mark.parametrize(("sigma", "even"), [(0.7, True), (1.5, False)])
def test_stamps_of_receipt_that_vary(sigma: float, even: bool) -> None:
    """Batches that arrive up to a step late are even; beyond it their samples have no times."""
    late = STEP * np.random.default_rng(2).normal(0.0, sigma, N // 8).repeat(8)
    stamps = in_batches(8, 0, last=True) + late
    if even:
        np.testing.assert_allclose(taken(stamps), TRUE, atol=0.2 * STEP)
        return
    with pytest.raises(StampError, match="7000 of 8000 samples have the stamp"):
        taken(stamps)


@pytest.mark.parametrize(("lost", "even"), [(2, True), (4, False), (8, False)])
def test_lost_samples_of_batches(lost: int, even: bool) -> None:
    """Samples that are lost shift all later ones, so that shared stamps say nothing beyond that."""
    stamps = np.delete(in_batches(8, 0, last=True), np.arange(4000, 4000 + lost))
    if even:
        assert np.abs(taken(stamps) - np.delete(TRUE, [4000, 4001])).max() < 1.1 * STEP
        return
    text = rf"imu.csv: \d+ of {N - lost} samples have the stamp .*, and are not even; record each"
    with pytest.raises(StampError, match=text):
        taken(stamps)


def shaken() -> FloatArray:
    """Return stamps of a sensor that does not sample evenly, in microseconds."""
    return np.round(TRUE + STEP * np.random.default_rng(3).normal(0.0, 0.1, N), 6)


@pytest.mark.parametrize(
    "stamps",
    [
        TRUE,
        shaken(),
        np.delete(shaken(), np.arange(0, N, 20)),
        np.round(2.0 * TRUE, 3),  # 200 Hz in ms
        np.delete(np.round(2.0 * TRUE, 3), 4000),
        np.round(TRUE + 7e-4 * np.random.default_rng(5).choice([-1.0, 1.0], N), 3),
        np.delete(np.round(4.0 * TRUE, 2), 4000),  # 100 Hz in ms and in 10 ms
        TRUE[:3],
        TRUE[:1],
        TRUE[:0],
    ],
)
def test_stamps_of_single_samples_are_kept(stamps: FloatArray) -> None:
    """Jitter that is no rounding, lost samples and exact stamps stay as they are, in each bit."""
    np.testing.assert_array_equal(taken(stamps), stamps)


@pytest.mark.parametrize(("step", "corrected"), [(0.0098, True), (0.0102, False)])
def test_fine_resolutions_are_kept(step: float, corrected: bool) -> None:
    """A resolution of 1 ms matters for a step of 9.8 ms, and for one of 10.2 ms it does not."""
    true = (step + 1e-5) * np.arange(1000)
    assert ((taken(np.round(true, 3)) != np.round(true, 3)).any()) == corrected


@pytest.mark.parametrize("pause", [2.0, 60.0])
def test_pauses_between_batches(pause: float) -> None:
    """After a pause the clock begins anew; one of a minute is no usual step either."""
    true = np.where(np.arange(N) < 4000, TRUE, TRUE + pause + 0.3 * STEP)
    stamps = np.where(np.arange(N) < 4000, 0.3 * STEP, pause + 0.6 * STEP)
    stamps = in_batches(8, 0, last=True) + stamps
    np.testing.assert_allclose(taken(stamps), true + 0.3 * STEP, atol=1e-6)


def test_copies_count_once() -> None:
    """What was recorded twice is no batch; another value with the same stamp is one."""
    twice = np.repeat(SIGNALS, 2, axis=0)
    times, signals = even_samples("a", np.repeat(shaken(), 2), twice, StampError)
    np.testing.assert_array_equal(times, shaken())
    np.testing.assert_array_equal(signals, SIGNALS)
    twice[5] += 0.1
    times, _ = even_samples("a", np.repeat(shaken(), 2), twice, StampError)
    assert len(times) == 2 * N


def test_samples_without_times_are_refused() -> None:
    """Stamps that are all equal, or those of seven batches, show no clock; eight show one."""
    seven, eight = (np.arange(0.0, n, 0.1) // 1.0 for n in (6.95, 7.95))
    assert np.ptp(np.diff(taken(eight))) < 1e-9
    for stamps, count in ((np.zeros(100), 99), (seven, 63)):
        with pytest.raises(StampError, match=f"{count} of {len(stamps)} samples have the stamp"):
            taken(stamps)
