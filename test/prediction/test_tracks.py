# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Two tracks of an isotropic plane against random planes, simulations in time, and closed forms.

No plane here is made by the formula of the coherence: it is a sum of waves in all directions.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad, trapezoid
from scipy.signal import cont2discrete, lfilter

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism, Mount
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.prediction.excitation import excitations_from_mapping
from linkage_vibration.prediction.ground import (
    GroundSquares,
    GroundTable,
    Terrain,
    ground_lines,
    ground_spectrum,
    ground_squares,
    ground_transfer,
    mean_squares,
)
from linkage_vibration.prediction.level_cache import level_cache
from linkage_vibration.prediction.loads import ExcitationError
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.table.table import Table
from test.support.in_plane import plane_mechanism, plane_table

BASE, STIFFNESS, DAMPING = 2.5, 200.0e3, 1000.0  # m; N/m and N s/m of each of two mounts
MASS = 1000.0  # kg, which only heaves
GROUND = {"speed": "ground", "terrain": {"class": "C"}, "raised": True}


def plane(
    f: FloatArray,
    speed: float,
    exponent: float,
    places: Sequence[float],
    seed: int,
    lowest: float = 0.3,
) -> FloatArray:
    """Return heights of a random plane beside a path at times, (n_places, 2 len(f) - 2), m.

    Its waves have all directions and the density (n^2 + m^2)^-(exponent + 1)/2; the density along
    any path is that of class C up to 20 Hz. Frequencies are those of ``rfftfreq``.
    """
    rng, step = np.random.default_rng(seed), f[1]
    inside = np.flatnonzero((f >= lowest) & (f <= 20.0))
    n = f[inside, np.newaxis] / speed
    # With m = n sinh(u), the density over u is cosh(u)^-exponent; one wave for each step of u.
    u, du = np.linspace(-6.0, 6.0, 80, retstep=True)
    weights = np.cosh(u) ** -exponent
    across = n * np.sinh(u + du * rng.uniform(-0.5, 0.5, (len(n), len(u))))
    density = 256e-6 * (n / 0.1) ** -exponent / speed * weights / weights.sum()
    waves = rng.normal(size=across.shape) + 1j * rng.normal(size=across.shape)
    waves *= np.sqrt(density * step / 4.0)
    count = 2 * len(f) - 2
    heights = np.zeros((len(places), len(f)), complex)
    for row, y in zip(heights, places, strict=True):
        row[inside] = (waves * np.exp(2j * math.pi * across * y)).sum(axis=1)
    return np.asarray(np.fft.irfft(heights, count) * count)


@pytest.mark.parametrize("exponent", [1.0, 1.6, 2.0, 2.6, 3.0])
def test_coherence_follows_from_the_density_of_an_isotropic_plane(exponent: float) -> None:
    """It is the integral of (1 + t^2)^-(w + 1)/2 cos(x t), over that at 0, with t = m / n."""
    terrain, apart = Terrain(256e-6, exponent), 1.6
    n = np.array([1e-3, 0.03, 0.1, 0.3, 1.0])

    def density(t: float) -> float:
        return float((1.0 + t * t) ** (-(exponent + 1.0) / 2.0))

    whole = quad(density, 0.0, math.inf)[0]
    expected = [
        quad(density, 0.0, math.inf, weight="cos", wvar=math.tau * each * apart)[0] / whole
        for each in n.tolist()
    ]
    np.testing.assert_allclose(terrain.coherence(n, apart), expected, atol=1e-7)
    closed = {1.0: lambda x: np.exp(-x), 3.0: lambda x: (1.0 + x) * np.exp(-x)}
    if exponent in closed:
        x = np.append(math.tau * n * apart, 1e6)
        np.testing.assert_allclose(
            terrain.coherence(np.append(n, 1e5), apart), closed[exponent](x), atol=1e-12
        )


def mounts_of(tracks: Sequence[float]) -> tuple[Mount, ...]:
    """Return a rear and a front mount with tracks."""
    kind = (0.0, STIFFNESS), (0.0, DAMPING)
    rear, front = tracks
    return Mount("rear", (0.0, 0.0), *kind, rear), Mount("front", (BASE, 0.0), *kind, front)


def squares_of(terrain: Terrain, mounts: Sequence[Mount]) -> GroundSquares:
    """Return the coefficients of the velocity of a mass that only heaves on two mounts."""
    heave = PoleResidue(
        np.array([2.0 * STIFFNESS / MASS + 0j]),
        np.array([2.0 * DAMPING / MASS]),
        np.full((1, 2, 1), 1.0 / MASS + 0j),
        np.zeros((1, 2, 1), dtype=complex),
        np.zeros((1, 2), dtype=complex),
    )
    lines = ground_lines(terrain)
    return ground_squares(
        ground_transfer(heave, mounts, lines, [("E1", "z")]), [1], mounts, terrain, lines
    )


def rms_of(squares: GroundSquares, speed: float) -> float:
    """Return the level at a speed."""
    return math.sqrt(mean_squares(squares, np.array([speed]))[0, 0])


def times(speed: float, minutes: float) -> tuple[float, int, FloatArray]:
    """Return a time step, s, which divides the delay of the axles, by how much, and frequencies."""
    late = math.ceil(BASE / speed / 4e-3)
    step = BASE / speed / late
    return step, late, np.arange(round(30.0 * minutes / step) + 1) / (60.0 * minutes)


@pytest.mark.parametrize(
    ("tracks", "speed", "exponent"),
    [
        *(pytest.param((1.6, 1.6), speed, 2.0, marks=pytest.mark.nightly) for speed in (1.5, 8.0)),
        pytest.param((0.0, 1.6), 1.5, 2.0, marks=pytest.mark.nightly),
        ((1.2, 1.8), 3.0, 2.6),
    ],
)
def test_a_mass_on_two_axles_has_the_level_of_a_simulation_in_time(
    tracks: tuple[float, float], speed: float, exponent: float
) -> None:
    """An hour over a random plane differs by less than 3 %, its standard error is about 1 %."""
    step, late, f = times(speed, 60.0)
    places = [side * track / 2.0 for track in tracks for side in (-1.0, 1.0)]
    heights = plane(f, speed, exponent, places, 1)
    mean = heights.reshape(2, 2, -1).mean(axis=1)
    height = np.roll(mean[0], late) + mean[1]
    force = STIFFNESS * height + DAMPING * np.gradient(height, step)
    numerator, denominator, _ = cont2discrete(
        ([1.0 / MASS, 0.0], [1.0, 2.0 * DAMPING / MASS, 2.0 * STIFFNESS / MASS]), step, "foh"
    )
    velocity = lfilter(np.ravel(numerator), denominator, force)[round(10.0 / step) :]
    terrain = Terrain(256e-6, exponent)
    level = rms_of(squares_of(terrain, mounts_of(tracks)), speed)
    assert math.sqrt(np.mean(velocity**2)) == pytest.approx(level, rel=0.03)
    one_track = rms_of(squares_of(terrain, mounts_of((0.0, 0.0))), speed)
    assert level < 0.94 * one_track


def test_tracks_that_are_one_or_far_apart() -> None:
    """A track of 0 changes no bit, and tracks far apart have half of the mean square.

    Where one axle has a single wheel, the other one's tracks are not coherent with it.
    """
    speeds = np.array([0.5, 3.0, 20.0])
    plain = Terrain(256e-6)
    one = mean_squares(squares_of(plain, mounts_of((0.0, 0.0))), speeds)
    same = mean_squares(squares_of(replace(plain, track=0.0), mounts_of((1.6, 1.6))), speeds)
    np.testing.assert_array_equal(same, one)
    for exponent in (2.0, 1.6):
        terrain = Terrain(256e-6, exponent)
        whole, half, mixed = (
            mean_squares(squares_of(terrain, mounts_of(tracks)), speeds)
            for tracks in ((0.0, 0.0), (1e4, 1e4), (0.0, 1e4))
        )
        np.testing.assert_allclose(half, whole / 2.0, rtol=1e-6)
        apart = replace(squares_of(terrain, mounts_of((0.0, 0.0))), apart=np.array([1e6]))
        np.testing.assert_allclose(mixed, 0.75 * mean_squares(apart, speeds), rtol=1e-6)
    given = mean_squares(squares_of(replace(plain, track=1.6), mounts_of((0.0, 0.0))), speeds)
    own = mean_squares(squares_of(plain, mounts_of((1.6, 1.6))), speeds)
    np.testing.assert_array_equal(given, own)


def test_mean_and_half_difference_are_those_of_a_plane() -> None:
    """Over octaves, their densities differ by less than three standard errors from a random plane.

    Their sum is the density of one track, and the difference of one wheel with itself is 0.
    """
    speed, track, terrain = 4.0, 1.6, Terrain(256e-6)
    _, _, f = times(speed, 60.0)
    left, right = np.fft.rfft(plane(f, speed, 2.0, (-track / 2.0, track / 2.0), 3))
    f, left, right = f[1:], left[1:], right[1:]
    whole = 256e-6 * (f / speed / 0.1) ** -2.0 / speed * f[0] / 2.0 * (2.0 * len(f)) ** 2
    for difference, heights in ((False, left + right), (True, left - right)):
        share = terrain.share(f / speed, (track, track), difference=difference)
        actual = np.abs(heights / 2.0) ** 2 / whole
        for low in (0.3, 0.6, 1.2, 2.4, 4.8):
            kept = (f >= low) & (f < 2.0 * low)
            error = actual[kept].std() / math.sqrt(kept.sum())
            assert abs(actual[kept].mean() - share[kept].mean()) < 3.0 * error
    both = [terrain.share(f, (track, track), difference=each) for each in (False, True)]
    np.testing.assert_allclose(sum(both), 1.0, rtol=1e-12)
    assert not terrain.share(f, (0.0, 0.0), difference=True).any()


@pytest.fixture(scope="module")
def shipped() -> tuple[Mechanism, Table]:
    """Return the shipped tractor in the plane, with 1.6 m between the wheels, and its table."""
    return plane_mechanism(), plane_table()


@pytest.mark.nightly(short="test_level_of_the_tractor_is_that_of_its_spectrum")
def test_tractor_is_shaken_as_in_a_simulation_in_time(shipped: tuple[Mechanism, Table]) -> None:
    """All modal coordinates are integrated over four minutes; one track would be 9 errors off."""
    simulation = pytest.importorskip("benchmark.ground", reason="it needs exudyn")
    mechanism, table = shipped
    assert mechanism.base is not None
    mounts, alpha3, speed, minutes = mechanism.base.mounts, math.radians(135.0), 12.0 / 3.6, 4.0
    step, late, f = times(speed, minutes)
    heights = plane(f, speed, 2.0, (-0.8, 0.8), 3).mean(axis=0)
    under = np.stack([np.roll(heights, late), heights], axis=1)
    rates = np.gradient(under, step, axis=0)
    solution = LinkageModel(mechanism).solve(alpha3)
    simulated = simulation.simulate(solution, mounts, step, under, rates)
    terrain = Terrain(256e-6)
    new, old = (
        GroundTable(table, mechanism, each, [("lift_cylinders", "force")]).at(alpha3, speed)
        for each in (terrain, replace(terrain, track=0.0))
    )
    lines, density = ground_spectrum(table, mechanism, terrain, ("E1", "z"), alpha3, speed)
    error = simulation.standard_error(density, lines, 60.0 * minutes)
    rms = simulation.rms(simulated.velocity)
    assert abs(rms / new.velocity[0] - 1.0) < 2.0 * error < 0.08
    assert rms < (1.0 - 6.0 * error) * old.velocity[0]
    cylinders = simulation.rms(simulated.cylinders)
    assert cylinders == pytest.approx(math.sqrt(new.forces2[0, 0]), rel=0.07)


def test_level_of_the_tractor_is_that_of_its_spectrum(shipped: tuple[Mechanism, Table]) -> None:
    """It is up to 29 % below that of one track, and the share off the ground is that of a wheel."""
    mechanism, table = shipped
    speeds = np.array([5.0, 12.0, 20.0, 30.0]) / 3.6
    terrain = Terrain(256e-6)
    new, old = (
        GroundTable(table, mechanism, each).at(np.radians([90.0]), speeds)
        for each in (terrain, replace(terrain, track=0.0))
    )
    assert (new.velocity < 0.83 * old.velocity).all()
    assert (new.velocity > 0.707 * old.velocity).all()
    np.testing.assert_allclose(new.off_ground_share, old.off_ground_share, rtol=1e-5)
    for level, speed in zip(new.velocity, speeds, strict=True):
        density = ground_spectrum(table, mechanism, terrain, ("E1", "z"), math.pi / 2.0, speed)
        assert level**2 == pytest.approx(trapezoid(density[1], density[0]), rel=2e-3)


def test_a_track_changes_levels_but_no_table(shipped: tuple[Mechanism, Table]) -> None:
    """The table of a mechanism stays valid, but levels that were kept in files are not used."""
    mechanism, table = shipped
    assert mechanism.base is not None
    mounts = tuple(replace(mount, track=1.9) for mount in mechanism.base.mounts)
    wider = replace(mechanism, base=replace(mechanism.base, mounts=mounts))
    assert wider.model_hash == mechanism.model_hash
    first, other = (level_cache(table, each, ()).key for each in (mechanism, wider))
    assert first != other


def test_description_of_the_track(tmp_path: Path) -> None:
    """It is a distance up to 10 m, and not given beside a profile of two tracks."""
    [first] = excitations_from_mapping({"field": GROUND | {"track": 1.8}})
    assert first.terrain is not None
    assert first.terrain.tracks(mounts_of((1.6, 1.2))) == [1.8, 1.8]
    for value in (-0.1, 10.1):
        with pytest.raises(ExcitationError, match=r"field\.track: .*; give 0 to 10 m"):
            excitations_from_mapping({"field": GROUND | {"track": value}})
    write_tracks(tmp_path / "road.csv", 4.0, 1.0)
    path = tmp_path / "mine.yaml"
    path.write_text("f: {speed: ground, terrain: {profile: road.csv}, raised: true, track: 1.6}\n")
    with pytest.raises(ExcitationError, match=r"f\.track: road\.csv has both tracks already"):
        read_excitations(path)


def write_tracks(path: Path, speed: float, minutes: float) -> None:
    """Write two tracks of a random plane, 1.6 m apart, with a sample each 0.1 m."""
    f = np.fft.rfftfreq(2 * round(30.0 * minutes * speed / 0.1), 0.1 / speed)
    heights = plane(f, speed, 2.0, (-0.8, 0.8), 4, 0.01)
    np.savetxt(path, np.column_stack([0.1 * np.arange(heights.shape[1]), *heights]), delimiter=",")


def test_measured_tracks_have_their_own_mean_and_difference(tmp_path: Path) -> None:
    """Over five kilometres the levels differ by less than 5 % from those of the isotropic plane."""
    speed, mounts, n = 4.0, mounts_of((1.6, 1.6)), np.geomspace(0.1, 1.0, 20)
    write_tracks(tmp_path / "road.csv", speed, 21.0)
    path = tmp_path / "mine.yaml"
    path.write_text("f: {speed: ground, terrain: {profile: road.csv}, raised: true}\n")
    [measured] = read_excitations(path)
    assert measured.terrain is not None
    exact = Terrain(256e-6)
    levels = [rms_of(squares_of(each, mounts), speed) for each in (measured.terrain, exact)]
    assert levels[0] == pytest.approx(levels[1], rel=0.05)
    for difference in (False, True):
        actual, expected = (
            each.share(n, (1.6, 1.6), difference=difference) * each.psd(n, np.ones(1))
            for each in (measured.terrain, exact)
        )
        assert (actual / expected).mean() == pytest.approx(1.0, abs=0.1)
