# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Modes identified from FRFs, against the modes that the FRFs were made from."""

import math
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from linkage_vibration.mechanics.description import LossFactor, Mechanism, Rayleigh
from linkage_vibration.mechanics.identification import (
    IdentificationError,
    IdentifiedModes,
    identify,
)
from linkage_vibration.mechanics.model import LinkageModel

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

LINES = np.linspace(0.1, 200.0, 2000)
PLACES = [("E1", "z"), ("E1", "x"), ("E2", "x"), ("V1", "z")]
BAND = (0.0, 200.0)


def receptances(
    frequencies: FloatArray,
    natural: FloatArray,
    ratios: FloatArray,
    shapes: FloatArray,
    n_in: int = 1,
) -> ComplexArray:
    """Return FRFs of modes in Hz, forces at the first outputs, (n_freq, n_out, n_in)."""
    w, w0 = 2.0 * math.pi * frequencies[:, np.newaxis], 2.0 * math.pi * natural
    terms = 1.0 / (w0**2 - w**2 + 2j * ratios * w0 * w)
    return np.asarray(np.einsum("or,ir,lr->loi", shapes, shapes[:n_in], terms))


def noisy(frf: ComplexArray, share: float, seed: int = 0) -> ComplexArray:
    """Return FRFs with complex normal noise, its standard deviation a share of each value."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(frf.shape) + 1j * rng.standard_normal(frf.shape)
    return frf * (1.0 + share * noise / math.sqrt(2.0))


def mac(actual: FloatArray, shapes: FloatArray) -> FloatArray:
    """Return how alike shapes are, one by one, (n,)."""
    product = (actual * shapes).sum(axis=0) ** 2
    return np.asarray(product / (actual**2).sum(axis=0) / (shapes**2).sum(axis=0))


def check(
    actual: IdentifiedModes,
    natural: FloatArray,
    ratios: FloatArray,
    shapes: FloatArray,
    *,
    frequency: float,
    damping: float,
    unlike: float,
    scale: float,
) -> None:
    """Assert that these modes were found, all of them and no other, within relative errors."""
    assert len(actual.omega) == len(natural)
    np.testing.assert_allclose(actual.omega / (2.0 * math.pi), natural, rtol=frequency)
    np.testing.assert_allclose(actual.damping_ratios, ratios, rtol=damping)
    assert mac(actual.shapes, shapes).min() > 1.0 - unlike
    np.testing.assert_allclose(np.abs(actual.shapes[0]), np.abs(shapes[0]), rtol=scale)


@pytest.mark.parametrize("alpha3_deg", np.linspace(90.0, 180.0, 10))
def test_linkage_from_coupled_frfs(model: LinkageModel, alpha3_deg: float) -> None:
    """All three modes of the linkage, 2.8 to 188 Hz, and no other, from lines 0.1 Hz apart.

    Modes 4 and 5 lie above the lines, as near as 206 Hz.
    """
    alpha3 = math.radians(alpha3_deg)
    frf = model.coupled_frf(alpha3, LINES, PLACES, PLACES[:1]).values
    solution = model.solve(alpha3)
    inside = solution.natural_frequencies < BAND[1]
    assert inside.sum() == 3
    check(
        identify(LINES, frf, BAND),
        solution.natural_frequencies[inside],
        solution.damping_ratios[inside],
        solution.participation(PLACES)[:, inside],
        frequency=1e-8,
        damping=1e-6,
        unlike=1e-9,
        scale=1e-5,
    )


@pytest.mark.parametrize("alpha3_deg", [102.0, 104.0, 168.0])
def test_cancelling_pairs_are_no_modes(printed: Mechanism, alpha3_deg: float) -> None:
    """Poles that a zero cancels to 1e-9, and that recur from order to order, are not reported."""
    model, alpha3 = LinkageModel(printed), math.radians(alpha3_deg)
    actual = identify(LINES, model.coupled_frf(alpha3, LINES, PLACES, PLACES[:1]).values, BAND)
    expected = model.solve(alpha3).modes.omega[:3]
    assert len(actual.omega) == 3
    np.testing.assert_allclose(actual.omega, expected, rtol=1e-8)


@pytest.mark.parametrize("alpha3_deg", [90.0, 140.0, 180.0])
def test_linkage_with_noise(model: LinkageModel, alpha3_deg: float) -> None:
    """1 % of noise on each value leaves frequencies within 0.1 %, damping ratios within 3 %.

    Shapes stay within a MAC of 0.999. Their scale is that of the drive point's residue, which is
    the smallest of mode 3 at 90 deg: within 15 %.
    """
    alpha3 = math.radians(alpha3_deg)
    frf = model.coupled_frf(alpha3, LINES, PLACES, PLACES[:1]).values
    solution = model.solve(alpha3)
    for seed in range(4):
        check(
            identify(LINES, noisy(frf, 0.01, seed), BAND),
            solution.natural_frequencies[:3],
            solution.damping_ratios[:3],
            solution.participation(PLACES)[:, :3],
            frequency=1e-3,
            damping=0.03,
            unlike=1e-3,
            scale=0.15,
        )


def test_narrow_bands(model: LinkageModel) -> None:
    """A band about one mode shows that mode; one between two modes is refused with an error."""
    alpha3 = math.radians(140.0)
    frf = model.coupled_frf(alpha3, LINES, PLACES, PLACES[:1]).values
    solution = model.solve(alpha3)
    for mode, band in enumerate([(0.0, 20.0), (60.0, 120.0), (130.0, 200.0)]):
        check(
            identify(LINES, frf, band),
            solution.natural_frequencies[[mode]],
            solution.damping_ratios[[mode]],
            solution.participation(PLACES)[:, [mode]],
            frequency=1e-8,
            damping=1e-6,
            unlike=1e-9,
            scale=1e-5,
        )
    with pytest.raises(IdentificationError, match="No mode is visible between 20 and 60 Hz"):
        identify(LINES, frf, (20.0, 60.0))


def test_links_damped_each_in_its_way(mechanism: Mechanism) -> None:
    """Complex modes: poles of l^2 M + l C + K, and shapes close to the undamped ones."""
    rules = [Rayleigh(3.0, 1e-6), Rayleigh(0.1, 4e-5), Rayleigh(0.0, 2e-4), Rayleigh(1.0, 2e-5)]
    pairs = zip(mechanism.links, rules, strict=True)
    links = tuple(replace(link, damping=rule) for link, rule in pairs)
    model, alpha3 = LinkageModel(replace(mechanism, links=links)), math.radians(140.0)
    modes = identify(LINES, model.coupled_frf(alpha3, LINES, PLACES, PLACES[:1]).values, BAND)
    solution = model.solve(alpha3)
    system = solution.coupled
    inverse = -np.linalg.solve(system.stiffness, np.hstack([system.damping, system.mass]))
    eye = np.eye(len(inverse))
    poles = 1.0 / np.linalg.eigvals(np.vstack([inverse, np.hstack([eye, 0.0 * eye])]))
    upper = poles[poles.imag > 1.0]
    np.testing.assert_allclose(modes.poles, upper[np.argsort(np.abs(upper))][:3], rtol=1e-8)
    assert mac(modes.shapes, solution.participation(PLACES)[:, :3]).min() > 0.999


def test_loss_factor(mechanism: Mechanism) -> None:
    """Structural damping eta shows as zeta = eta / 2."""
    model = LinkageModel(replace(mechanism, damping=LossFactor(0.02)))
    alpha3 = math.radians(140.0)
    modes = identify(LINES, model.coupled_frf(alpha3, LINES, PLACES, PLACES[:1]).values, BAND)
    solution = model.solve(alpha3)
    check(
        modes,
        solution.natural_frequencies[:3],
        np.full(3, 0.01),
        solution.participation(PLACES)[:, :3],
        frequency=1e-3,
        damping=1e-2,
        unlike=1e-3,
        scale=1e-2,
    )


@pytest.mark.parametrize("ratio", [0.005, 0.01, 0.03])
@pytest.mark.parametrize("n_in", [1, 2])
def test_two_close_modes(ratio: float, n_in: int) -> None:
    """Modes 0.5 % apart, a tenth of a bandwidth at worst, come out as two."""
    natural, ratios = np.array([57.0, 57.285, 230.0]), ratio * np.array([1.0, 1.2, 1.0])
    shapes = np.array([[0.9, 0.5, 1.0], [-0.4, 0.8, -0.6], [0.7, -0.3, 0.2]])
    frf = receptances(LINES, natural, ratios, shapes, n_in)
    exact = {"frequency": 1e-8, "damping": 1e-6, "unlike": 1e-9, "scale": 1e-5}
    check(identify(LINES, frf, BAND), natural[:2], ratios[:2], shapes[:, :2], **exact)
    if n_in == 2 and ratio < 0.02:
        rough = {"frequency": 2e-3, "damping": 0.1, "unlike": 0.01, "scale": 0.1}
        modes = identify(LINES, noisy(frf, 0.01), BAND)
        check(modes, natural[:2], ratios[:2], shapes[:, :2], **rough)


def test_many_modes() -> None:
    """Random systems of ten modes, six more above the band: all of them and no other."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        low = np.geomspace(3.0, 180.0, 10) * rng.uniform(0.9, 1.1, 10)
        natural = np.concatenate([low, rng.uniform(205.0, 900.0, 6)])
        ratios = rng.uniform(0.005, 0.03, 16)
        shapes = rng.uniform(0.3, 1.0, (4, 16)) * rng.choice([-1.0, 1.0], (4, 16))
        check(
            identify(LINES, receptances(LINES, natural, ratios, shapes), BAND),
            natural[:10],
            ratios[:10],
            shapes[:, :10],
            frequency=1e-6,
            damping=1e-4,
            unlike=1e-6,
            scale=1e-3,
        )


def test_uneven_lines() -> None:
    """Lines may be spaced in any way, here by equal ratios, and an output may not move."""
    natural, ratios = np.array([4.0, 95.0, 170.0, 240.0]), np.array([0.02, 0.01, 0.015, 0.02])
    shapes = np.array([[0.9, 0.5, 1.0, 1.0], [-0.4, 0.8, -0.6, 0.5], [0.0, 0.0, 0.0, 0.0]])
    lines = np.geomspace(0.5, 200.0, 700)
    modes = identify(lines, receptances(lines, natural, ratios, shapes), BAND)
    exact = {"frequency": 1e-8, "damping": 1e-6, "unlike": 1e-9, "scale": 1e-5}
    check(modes, natural[:3], ratios[:3], shapes[:, :3], **exact)


def test_shapes_of_two_inputs() -> None:
    """They are mass-normalised, and positive at the first output."""
    natural, ratios = np.array([40.0, 90.0]), np.array([0.01, 0.02])
    shapes = np.array([[0.9, 0.5], [-0.4, 0.8], [0.7, -0.3]])
    frf = receptances(LINES, natural, ratios, shapes, 2)
    np.testing.assert_allclose(identify(LINES, frf, BAND).shapes, shapes, rtol=1e-8)


def single(frequencies: FloatArray, ratio: float = 0.01) -> ComplexArray:
    """Return the FRF of one mode at 50 Hz."""
    return receptances(frequencies, np.array([50.0]), np.array([ratio]), np.array([[1.0]]))


def test_too_few_lines_for_a_peak() -> None:
    """A peak that fits between two lines is refused, with its width and their distance."""
    lines = np.linspace(1.0, 200.0, 100)
    with pytest.raises(IdentificationError, match=r"peak at 50 Hz is 0.1 Hz wide.*2 Hz apart"):
        identify(lines, single(lines, 0.001), BAND)
    for spacings, refused in ((4.9, False), (5.1, True)):  # of 0.1 Hz, in half-power bandwidths
        frf = single(LINES, 0.1 / (2.0 * 50.0 * spacings))
        with pytest.raises(IdentificationError) if refused else nullcontext():
            assert len(identify(LINES, frf, BAND).omega) == 1


def test_lines_that_are_coarse_elsewhere() -> None:
    """Lines need to be close at a peak alone: below it, they may be 19 Hz apart."""
    lines = np.concatenate([[1.0, 20.0], LINES[LINES > 25.0]])
    assert len(identify(lines, single(lines), BAND).omega) == 1
    lines = np.concatenate([LINES[LINES < 48.0], np.arange(49.0, 200.0, 6.0)])
    with pytest.raises(IdentificationError):
        identify(lines, single(lines), BAND)


def test_too_few_lines_in_the_band() -> None:
    """A band of 21 lines is refused."""
    lines = np.linspace(1.0, 200.0, 200)
    with pytest.raises(IdentificationError, match="Only 21 lines lie between 40 and 60 Hz"):
        identify(lines, single(lines), (40.0, 60.0))


def test_no_mode() -> None:
    """Noise alone, and FRFs of zero, hold no mode."""
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((400, 2, 1)) + 1j * rng.standard_normal((400, 2, 1))
    for frf in (noise, np.zeros((400, 2, 1), dtype=complex)):
        with pytest.raises(IdentificationError, match="No mode is visible between 0 and 200 Hz"):
            identify(np.linspace(0.5, 200.0, 400), frf, BAND)


SHAPES = np.array([[0.9, 0.5, 0.7, 1.0, 0.8], [-0.4, 0.8, -0.9, 0.5, 0.6]])
LOW = np.array([0.8, 3.0, 3.5, 7.0, 150.0])


@pytest.mark.parametrize(
    ("modes", "share"),
    [([0, 1, 2, 3, 4], 0.0), ([0, 1, 2, 3, 4], 1e-3), ([1, 2, 3, 4], 0.01), ([1, 3, 4], 0.05)],
)
def test_modes_below_ten_hertz(modes: list[int], share: float) -> None:
    """Modes from 0.8 Hz on come out beside one at 150 Hz, fewer in more noise."""
    frf = receptances(LINES, LOW[modes], np.full(len(modes), 0.02), SHAPES[:, modes])
    actual = identify(LINES, noisy(frf, share), BAND).omega / (2.0 * math.pi)
    assert len(actual) == len(modes)
    np.testing.assert_allclose(actual, LOW[modes], rtol=1e-8 + share)


def test_modes_that_noise_hides_are_reported() -> None:
    """Noise of 5 % hides the modes at 0.8 and 3.5 Hz; they are refused, not left out silently."""
    frf = noisy(receptances(LINES, LOW, np.full(5, 0.02), SHAPES), 0.05)
    with pytest.raises(IdentificationError, match=r"% of the FRFs unexplained near 2.3 Hz"):
        identify(LINES, frf, BAND)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (np.linspace(0.1, 150.0, 1500), r"cover 0\.1 to 150 Hz, not the whole band of 0 to 200 Hz"),
        (np.linspace(5.0, 200.0, 1951), r"cover 5 to 200 Hz, not the whole band of 0 to 200 Hz"),
    ],
)
def test_lines_short_of_the_band(model: LinkageModel, lines: FloatArray, words: str) -> None:
    """Lines up to 150 Hz hide mode 3 at 166 Hz, those from 5 Hz on mode 1; both are refused."""
    frf = model.coupled_frf(math.radians(140.0), lines, PLACES, PLACES[:1]).values
    with pytest.raises(IdentificationError, match=words):
        identify(lines, frf, BAND)


@pytest.mark.parametrize(("highest", "refused"), [(198.1, False), (197.9, True)])
def test_lines_may_end_a_little_before_the_band(highest: float, refused: bool) -> None:
    """One percent of a band of 200 Hz may be missing at an end."""
    lines = np.linspace(0.1, highest, 2000)
    with pytest.raises(IdentificationError, match="not the whole") if refused else nullcontext():
        assert len(identify(lines, single(lines), BAND).omega) == 1


@pytest.mark.parametrize("share", [0.0, 1e-3, 1e-2])
def test_lines_too_coarse_for_light_damping(model: LinkageModel, share: float) -> None:
    """Lines 0.1 Hz apart and damping ratios of 0.02 %: refused in any noise, with both widths."""
    solution = model.solve(math.radians(140.0))
    shapes = solution.participation(PLACES)[:, :8]
    frf = receptances(LINES, solution.natural_frequencies[:8], np.full(8, 2e-4), shapes)
    with pytest.raises(IdentificationError, match=r"Hz wide, but the lines there are 0.1 Hz apart"):
        identify(LINES, noisy(frf, share), BAND)


def test_a_noisy_line_is_no_mode() -> None:
    """A line off by 1 % on the flank of a peak is not taken for a mode of its own."""
    frf = single(LINES, 0.02)
    for line in range(480, 520, 5):
        spoilt = noisy(frf, 1e-4)
        spoilt[line] *= 1.01
        assert len(identify(LINES, spoilt, BAND).omega) == 1
