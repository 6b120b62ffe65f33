# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Levels by the ground against closed forms, sums over many lines, and simulations in time."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid, trapezoid
from scipy.signal import welch

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.description import Mechanism, Mount
from linkage_vibration.mechanics.model import LinkageModel, Place
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.prediction.answers import (
    GroundAnswer,
    ModelWithoutTable,
    ServingError,
    answer_ground,
)
from linkage_vibration.prediction.excitation import excitations_from_mapping
from linkage_vibration.prediction.ground import (
    MAX_OFF_GROUND,
    REASONS,
    GroundError,
    GroundLevels,
    GroundTable,
    Terrain,
    _mean_spectrum,
    ground_lines,
    ground_spectrum,
    ground_squares,
    ground_transfer,
    mean_squares,
    power_law,
    profile_spectrum,
)
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation import build_table
from test.support.in_plane import plane_mechanism, plane_table
from test.support.served import shipped

MASS, STIFFNESS, DAMPING = 1000.0, 400.0e3, 2000.0  # of one mass on two mounts, kg, N/m and N s/m


def two_mounts(wheelbase: float) -> tuple[Mount, ...]:
    """Return two mounts that share the stiffness and the damping."""
    half = (0.0, STIFFNESS / 2.0), (0.0, DAMPING / 2.0)
    return Mount("rear", (0.0, 0.0), *half), Mount("front", (wheelbase, 0.0), *half)


def heave() -> PoleResidue:
    """Return the receptance of a mass that only heaves, to a force at each of two mounts."""
    return PoleResidue(
        np.array([STIFFNESS / MASS + 0j]),
        np.array([DAMPING / MASS]),
        np.full((1, 2, 1), 1.0 / MASS + 0j),
        np.zeros((1, 2, 1), dtype=complex),
        np.zeros((1, 2), dtype=complex),
    )


def closed_heave(f: FloatArray, wheelbase: float, speed: float) -> ComplexArray:
    """Return its velocity per height of the ground: both mounts act by halves, one of them late."""
    w = 2.0 * math.pi * f
    force = (STIFFNESS + 1j * w * DAMPING) * np.cos(w * wheelbase / speed / 2.0)
    return np.asarray(w * force / (STIFFNESS - MASS * w**2 + 1j * w * DAMPING))


def level_on_class_c(response: ComplexArray, f: FloatArray, speed: float) -> float:
    """Return the root mean square of a response, which is given per height of the ground."""
    density = 256e-6 * (f / speed / 0.1) ** -2.0 / speed
    return math.sqrt(trapezoid(np.abs(response) ** 2 * density, f))


@pytest.mark.parametrize("wheelbase", [0.0, 2.5, 40.0])
@pytest.mark.parametrize("speed", [3.0, 12.0])
def test_mass_on_two_mounts_has_the_level_of_its_closed_form(
    wheelbase: float, speed: float
) -> None:
    """The rms velocity differs by less than 1e-4 from the integral over 400,001 lines."""
    terrain, mounts = Terrain(256e-6), two_mounts(wheelbase)
    lines = ground_lines(terrain)
    transfer = ground_transfer(heave(), mounts, lines, [("E1", "z")])
    squares = ground_squares(transfer, [1], mounts, terrain, lines)
    fine = np.linspace(0.3, 20.0, 400_001)
    exact = level_on_class_c(closed_heave(fine, wheelbase, speed), fine, speed)
    level = mean_squares(squares, np.array([speed]))[0, 0]
    assert math.sqrt(level) == pytest.approx(exact, rel=1e-4)


def random_profile(
    terrain: Terrain, length: float, spacing: float, rng: np.random.Generator
) -> FloatArray:
    """Return heights of a random profile with the spectrum of a terrain, by Fourier's sum."""
    count = round(length / spacing)
    n = np.fft.rfftfreq(count, spacing)[1:]
    density = terrain.roughness * (n / terrain.reference) ** -terrain.exponent
    parts = rng.normal(size=len(n)) + 1j * rng.normal(size=len(n))
    # The mean square of each wave is its density times the step between wavenumbers.
    amplitudes = np.append(0.0, np.sqrt(density / (count * spacing) / 4.0) * parts)
    return np.asarray(np.fft.irfft(amplitudes, count) * count)


@pytest.mark.parametrize("exponent", [1.6, 2.0, 2.6])
def test_spectrum_of_a_random_profile_is_that_of_its_terrain(exponent: float) -> None:
    """Means over octaves differ by less than three standard errors, as 8 parts and overlaps give.

    The spectrum of the profile of 20 km ends at half of what the spacing shows.
    """
    terrain, rng = Terrain(256e-6, exponent), np.random.default_rng(7)
    length, spacing = 20_000.0, 0.1
    heights = random_profile(terrain, length, spacing, rng)
    at = spacing * np.arange(len(heights))
    n, density = np.array(profile_spectrum(at, heights)).T
    assert n[0] < 1e-3
    assert n[-1] == pytest.approx(0.25 / spacing, rel=0.1)
    ratio = density / (256e-6 * (n / 0.1) ** -exponent)
    octave = np.floor(np.log2(n / n[0]))
    for i in range(2, int(octave.max()) + 1):
        waves = 0.5 * n[0] * 2.0**i * length  # an octave has as many independent waves
        assert abs(ratio[octave == i].mean() - 1.0) < 3.0 * math.sqrt(1.1 / waves) + 0.01
    roughness, actual = power_law(list(zip(n, density, strict=True)), 0.1)
    assert actual == pytest.approx(exponent, abs=0.05)
    assert roughness == pytest.approx(256e-6, rel=0.1)


@pytest.mark.parametrize("length", [64, 125])
def test_welch_of_scipy(length: int) -> None:
    """Wavenumbers and densities are those of SciPy's Welch method, between 0 and the last one."""
    heights = np.cumsum(np.random.default_rng(9).normal(size=1001)) + 1e3
    n, density = _mean_spectrum(heights, 0.1, length)
    expected = welch(heights, 10.0, nperseg=length, detrend="linear")
    np.testing.assert_allclose(n, expected[0], rtol=1e-14)
    # That of half of the rate is one-sided, too; `profile_spectrum` leaves it out.
    np.testing.assert_allclose(density[1:-1], expected[1][1:-1], rtol=1e-9)


def test_measured_spectrum_gives_the_level_of_the_terrain() -> None:
    """Over ten kilometres the level differs by less than 5 % from that of the power law.

    Of the waves beyond the spectrum, some would matter at 1 m/s, but none at 8 m/s.
    """
    terrain, rng = Terrain(256e-6), np.random.default_rng(8)
    heights = random_profile(terrain, 10_000.0, 0.1, rng)
    spectrum = profile_spectrum(0.1 * np.arange(len(heights)), heights)
    roughness, exponent = power_law(spectrum, 0.1)
    measured = Terrain(roughness, exponent, spectrum=spectrum)
    mounts, lines = two_mounts(2.5), ground_lines(terrain)
    transfer = ground_transfer(heave(), mounts, lines, [("E1", "z")])
    speeds = np.array([1.0, 8.0])
    exact, lost = (
        mean_squares(ground_squares(transfer, [1], mounts, terrain, lines), speeds)[0],
        mean_squares(
            ground_squares(transfer, [1], mounts, measured, lines), speeds, uncovered=True
        )[0],
    )
    actual = mean_squares(ground_squares(transfer, [1], mounts, measured, lines), speeds)[0]
    assert math.sqrt(actual[1] / exact[1]) == pytest.approx(1.0, abs=0.05)
    assert lost[1] < 1e-3 * actual[1]
    assert 0.01 * exact[0] < lost[0] < exact[0]


def test_density_of_heights_integrates_to_their_mean_square() -> None:
    """It is G0 n0^2 speed (1 / f1 - 1 / f2) for the exponent 2."""
    f = np.linspace(0.3, 20.0, 200_001)
    total = trapezoid(Terrain(256e-6).psd(f, np.array(7.0)), f)
    assert total == pytest.approx(256e-6 * 0.01 * 7.0 * (1.0 / 0.3 - 1.0 / 20.0), rel=1e-6)


@pytest.mark.parametrize(("wheelbase", "speed"), [(2.5, 0.002), (1e5, 10.0)])
def test_mounts_do_not_act_together_if_the_delay_is_long(wheelbase: float, speed: float) -> None:
    """Slow, or with axles that are far apart, the level is that of two independent profiles."""
    terrain, mounts = Terrain(256e-6), two_mounts(wheelbase)
    lines = ground_lines(terrain)
    transfer = ground_transfer(heave(), mounts, lines, [("E1", "z")])
    squares = ground_squares(transfer, [1], mounts, terrain, lines)
    fine = np.linspace(0.3, 20.0, 200_001)
    density = 256e-6 * (fine / speed / 0.1) ** -2.0 / speed
    together = trapezoid(np.abs(closed_heave(fine, 0.0, speed)) ** 2 * density, fine)
    level = mean_squares(squares, np.array([speed]))[0, 0]
    assert level == pytest.approx(together / 2.0, rel=1e-3)


def test_three_mounts() -> None:
    """A heaving mass on three mounts has the level of the sum of three delayed forces."""
    third = (0.0, STIFFNESS / 3.0), (0.0, DAMPING / 3.0)
    mounts = tuple(
        Mount(name, (x, 0.0), *third) for name, x in (("a", 4.0), ("b", 0.0), ("c", 1.5))
    )
    terrain, speed = Terrain(256e-6), 6.0
    lines, first = ground_lines(terrain), heave()
    frf = replace(
        first,
        residues=first.residues[:, [0, 0, 0]],
        rates=first.rates[:, [0, 0, 0]],
        residual=first.residual[:, [0, 0, 0]],
    )
    transfer = ground_transfer(frf, mounts, lines, [("E1", "z")])
    level = mean_squares(ground_squares(transfer, [1], mounts, terrain, lines), np.array([speed]))[
        0, 0
    ]
    fine = np.linspace(0.3, 20.0, 200_001)
    late = sum(np.exp(-2j * math.pi * fine * x / speed) for x in (0.0, 4.0, 2.5)) / 3.0
    exact = level_on_class_c(closed_heave(fine, 0.0, speed) * late, fine, speed)
    assert math.sqrt(level) == pytest.approx(exact, rel=1e-4)


@dataclass(frozen=True)
class Tractor:
    """The shipped tractor."""

    mechanism: Mechanism
    table: Table
    model: LinkageModel

    def levels(self, terrain: Terrain, degrees: float, speed: float) -> GroundLevels:
        """Return the levels at one angle and speed."""
        lookup = GroundTable(self.table, self.mechanism, terrain, [CYLINDERS])
        return lookup.at(np.radians([degrees]), np.array([speed]))

    def densities(self, places: list[Place], degrees: float, speed: float) -> FloatArray:
        """Return densities of displacements or forces by class C over `FINE`, (n_places, n).

        They come from the assembled matrices without reduction to poles, line by line.
        """
        solution, (rear, front) = self.model.solve(math.radians(degrees)), MOUNTS
        frf = solution.frf(places, [("rear_axle", "z"), ("front_axle", "z")]).frf(FINE)
        w = 2.0 * math.pi * FINE[:, np.newaxis]
        total = frf[:, :, 1] * (front[0] + 1j * w * front[1])
        total += frf[:, :, 0] * (rear[0] + 1j * w * rear[1]) * np.exp(-1j * w * 2.5 / speed)
        height = 256e-6 * (FINE / speed / 0.1) ** -2.0 / speed
        return np.asarray((np.abs(total) ** 2).T * height)


CYLINDERS = ("lift_cylinders", "force")
MOUNTS = (700.0e3, 4460.0), (600.0e3, 3820.0)  # stiffness and damping of both axles, by the file
FINE = np.linspace(0.3, 20.0, 20_001)
CLASS_C = Terrain(256e-6, track=0.0)  # as the profiles of this file, under both wheels of an axle


@pytest.fixture(scope="module")
def tractor() -> Tractor:
    """Return the shipped tractor, in the plane."""
    mechanism = plane_mechanism()
    return Tractor(mechanism, plane_table(), LinkageModel(mechanism))


def test_levels_are_those_of_the_unreduced_model(tractor: Tractor) -> None:
    """Velocity, acceleration and the cylinders' force differ by less than 1e-3 at 40 km/h.

    The lookup has 512 lines, interpolates over the angle and the speed, and its links are reduced.
    """
    degrees, speed = 134.6, 40.0 / 3.6
    full = replace(tractor, model=LinkageModel(tractor.mechanism, reduced=False))
    moved, force = full.densities([("E1", "z"), CYLINDERS], degrees, speed)
    w = 2.0 * math.pi * FINE
    exact = [trapezoid(x, FINE) ** 0.5 for x in (moved * w**2, moved * w**4, force)]
    actual = tractor.levels(CLASS_C, degrees, speed)
    levels = [actual.velocity[0], actual.acceleration[0], math.sqrt(actual.forces2[0, 0])]
    np.testing.assert_allclose(levels, exact, rtol=1e-3)


def test_spectrum_at_any_place_sums_up_to_the_level_of_the_model(tractor: Tractor) -> None:
    """From the table and from the model, at a place and of a force, where the table knows both."""
    alpha3, speed = math.radians(150.0), 8.0
    places: list[Place] = [("V1", "x"), ("E2", "z"), CYLINDERS]
    exact = tractor.densities(places, 150.0, speed)
    exact[:2] *= (2.0 * math.pi * FINE) ** 2
    for i, place in enumerate(places):
        for source in (tractor.table, tractor.model):
            f, density = ground_spectrum(source, tractor.mechanism, CLASS_C, place, alpha3, speed)
            np.testing.assert_allclose(density[::50], np.interp(f[::50], FINE, exact[i]), rtol=0.01)


@pytest.fixture(scope="module")
def asking(tractor: Tractor) -> Callable[..., GroundAnswer]:
    """Return what answers a question at an angle, deg, a speed, m/s, and places about class C."""
    served = ModelWithoutTable(tractor.mechanism, "").with_predictor(Predictor(tractor.table))
    field = {"speed": "ground", "terrain": {"class": "C"}, "raised": True, "track": 0.0}
    lugs = {"lugs": 20, "rolling_radius": 0.8}
    excitations = excitations_from_mapping({"field": field | lugs})

    def ask(degrees: float, speed: float, *places: str) -> GroundAnswer:
        return answer_ground(served, excitations, math.radians(degrees), speed, places)

    return ask


def test_answer_has_levels_and_spectra_at_any_place(
    tractor: Tractor, asking: Callable[..., GroundAnswer]
) -> None:
    """They are those of the model without reduction, and each has a reason of its own."""
    exact = tractor.densities([("E1", "z"), ("V1", "x"), CYLINDERS], 150.0, 11.0)
    w = 2.0 * math.pi * FINE
    exact[:2] *= w**2
    names = "E1.z", "V1.x", "lift_cylinders.force"
    answer = asking(150.0, 11.0, *names)
    np.testing.assert_allclose(answer.levels, trapezoid(exact, FINE) ** 0.5, rtol=1e-3)
    accelerations = trapezoid(exact[:2] * w**2, FINE) ** 0.5
    np.testing.assert_allclose(answer.accelerations, [*accelerations, math.nan], rtol=1e-3)
    for density, fine in zip(answer.densities, exact, strict=True):
        near = np.interp(answer.frequencies, FINE, fine)
        np.testing.assert_allclose(density[::50], near[::50], rtol=0.01)
    assert answer.reasons == ("", "", "")
    assert 0.0 < answer.off_ground_share < MAX_OFF_GROUND
    assert asking(150.0, 11.0).levels.tolist() == answer.levels[:1].tolist()  # the drive point


def test_answer_says_why_a_place_is_not_known(
    tractor: Tractor, asking: Callable[..., GroundAnswer]
) -> None:
    """At 3 m/s half of the frequency of the lugs is 6 Hz, which V1 exceeds less than E1."""
    squares = tractor.densities([("E1", "z"), ("V1", "x")], 150.0, 3.0) * FINE**4
    above = 0.5 * 3.0 * 20.0 / (2.0 * math.pi * 0.8) < FINE
    lost = trapezoid(squares * above, FINE) / trapezoid(squares, FINE)
    assert (lost > 0.2).tolist() == [True, False]
    slow = asking(150.0, 3.0, "E1.z", "V1.x")
    assert ["frequency of the lugs" in reason for reason in slow.reasons] == [True, False]
    assert np.isnan(slow.levels).tolist() == [True, False]
    assert np.isnan(slow.densities).all(axis=1).tolist() == [True, False]
    assert "ground speed" not in asking(150.0, 100.0).reasons[0]
    for speed in (math.nan, math.inf, 100.1):
        with pytest.raises(ServingError, match=r"ground_speed is .* at most 100 m/s"):
            asking(150.0, speed)
    assert asking(250.0, 8.0).reasons[0].startswith("The crank angle")
    still = asking(150.0, 0.0)
    assert (still.levels[0], still.densities.max()) == (0.0, 0.0)
    for refused, places in (
        ("outputs has 9 places", ("E1.z",) * 9),
        (r"outputs\[1\] is 'Q.z'; name one of E1.z", ("E1.z", "Q.z")),
    ):
        with pytest.raises(ServingError, match=refused):
            asking(150.0, 8.0, *places)
    with pytest.raises(ServingError, match="No excitation has a terrain"):
        answer_ground(shipped(), (), 2.0, 8.0, [])


def test_spectrum_is_not_known_beyond_the_lugs_or_without_a_base(tractor: Tractor) -> None:
    """It is NaN above half of the frequency of the lugs; else the error gives the reason."""
    mechanism, place = tractor.mechanism, ("E1", "z")
    lugged = replace(CLASS_C, lug_pitch=0.5)
    f, density = ground_spectrum(tractor.table, mechanism, lugged, place, 2.0, 8.0)
    np.testing.assert_array_equal(np.isnan(density), f > 8.0)  # 8 m/s over twice 0.5 m
    for changed, terrain, speed, words in (
        (replace(mechanism, base=None), CLASS_C, 8.0, "no base"),
        (mechanism, replace(CLASS_C, raised=False), 8.0, "in the soil"),
        (mechanism, CLASS_C, 0.0, "ground speed"),
        (mechanism, CLASS_C, math.nan, "ground speed"),
    ):
        with pytest.raises(GroundError, match=words):
            ground_spectrum(tractor.table, changed, terrain, place, 2.0, speed)


def static_loads(mechanism: Mechanism, model: LinkageModel, degrees: float) -> FloatArray:
    """Return the loads of both axles by the lever rule, N, from masses and centres of gravity."""
    configuration = model.kinematics.at(math.radians(degrees))
    weights = [(4500.0, 1.6)]
    sections = {
        "lower_link": 2 * 0.050 * 0.032,
        "upper_link": math.pi / 4.0 * (0.080**2 - 0.040**2),
        "input_crank": 2 * 0.020 * 0.036,
        "lift_rod": 2 * math.pi / 4.0 * 0.029**2,
    }
    for link in mechanism.links:
        length = link.points[-1][1][0]
        middle = configuration.place(link.name, (length / 2.0, 0.0))
        weights.append((7800.0 * sections[link.name] * length, float(middle[0])))
    (implement,) = mechanism.rigid_bodies
    weights.append((800.0, float(configuration.place("implement", implement.centre_of_gravity)[0])))
    mass, first = (sum(m * x**power for m, x in weights) for power in (0, 1))
    front = (first - 0.6 * mass) / 2.5  # axles at 0.6 m and 3.1 m
    return 9.80665 * np.array([mass - front, front])


@pytest.mark.parametrize("degrees", [95.0, 140.0, 178.0])
def test_loads_of_the_axles_follow_from_the_lever_rule(tractor: Tractor, degrees: float) -> None:
    """They are equal but for the little by which the weight moves the linkage."""
    expected = static_loads(tractor.mechanism, tractor.model, degrees)
    actual = tractor.model.mount_loads(math.radians(degrees))
    np.testing.assert_allclose(actual, expected, rtol=1e-6)


def front_tyre(tractor: Tractor, degrees: float, speed: float, f: FloatArray) -> ComplexArray:
    """Return the force of the front tyre per height under it, and of the ground, N/m, (2, n_f)."""
    w, (rear, front) = 2.0 * math.pi * f, MOUNTS
    solution = tractor.model.solve(math.radians(degrees))
    frf = solution.frf([("front_axle", "z")], [("rear_axle", "z"), ("front_axle", "z")]).frf(f)
    ahead = front[0] + 1j * w * front[1]
    behind = (rear[0] + 1j * w * rear[1]) * np.exp(-1j * w * 2.5 / speed)
    own = ahead * (1.0 - frf[:, 0, 1] * ahead)
    return np.array([own, own - ahead * frf[:, 0, 0] * behind])


def deviation_of_front_tyre(tractor: Tractor, degrees: float, speed: float) -> float:
    """Return the standard deviation of the force of the front tyre on class C, N."""
    return level_on_class_c(front_tyre(tractor, degrees, speed, FINE)[1], FINE, speed)


def test_share_off_the_ground_refuses_levels_above_a_fifth(tractor: Tractor) -> None:
    """The share is that of a Gaussian force, and 0.198 is known while 0.202 is not."""
    degrees, speed = 140.0, 30.0 / 3.6
    load = static_loads(tractor.mechanism, tractor.model, degrees)[1]
    deviation = deviation_of_front_tyre(tractor, degrees, speed)
    for share, reason in ((0.198, ""), (0.202, "A tyre is off the ground")):
        # The share of a normal distribution beyond the load; the front axle is the light one.
        factor = load / (-NormalDist().inv_cdf(share) * deviation)
        actual = tractor.levels(Terrain(256e-6 * factor**2), degrees, speed)
        assert actual.off_ground_share[0] == pytest.approx(share, abs=5e-4)
        assert REASONS[actual.reason[0]].startswith(reason)
        assert math.isnan(actual.velocity[0]) == bool(reason)
        assert np.isnan(actual.forces2).all() == bool(reason)


def test_spectrum_of_the_force_of_a_tyre(tractor: Tractor) -> None:
    """It is that on the soil, which moves as well, and its integral is the level."""
    place, speed, degrees = ("base:front_axle", "force_z"), 30.0 / 3.6, 140.0
    deviation = deviation_of_front_tyre(tractor, degrees, speed)
    for source in (tractor.table, tractor.model):
        f, density = ground_spectrum(
            source, tractor.mechanism, CLASS_C, place, math.radians(degrees), speed
        )
        assert math.sqrt(trapezoid(density, f)) == pytest.approx(deviation, rel=1e-3)
    lookup = GroundTable(tractor.table, tractor.mechanism, CLASS_C, [place])
    level = lookup.at(np.radians([degrees]), np.array([speed]))
    assert math.sqrt(level.forces2[0, 0]) == pytest.approx(deviation, rel=1e-3)


@pytest.mark.parametrize(("share", "known"), [(0.195, True), (0.205, False)])
def test_lugs_refuse_levels_of_which_a_fifth_lies_above(
    tractor: Tractor, share: float, known: bool
) -> None:
    """The part above half of their frequency is left out, up to a fifth of the acceleration."""
    degrees, speed = 140.0, 3.0
    velocity = tractor.densities([("E1", "z")], degrees, speed)[0] * (2.0 * math.pi * FINE) ** 2
    below = cumulative_trapezoid(velocity * FINE**2, FINE, initial=0.0)
    limit = float(np.interp((1.0 - share) * below[-1], below, FINE))
    actual = tractor.levels(replace(CLASS_C, lug_pitch=speed / (2.0 * limit)), degrees, speed)
    assert REASONS[actual.reason[0]] == ("" if known else REASONS[4])
    assert "lugs" in REASONS[4]
    assert math.isnan(actual.velocity[0]) != known
    if known:
        kept = np.interp(limit, FINE, cumulative_trapezoid(velocity, FINE, initial=0.0))
        assert actual.velocity[0] == pytest.approx(math.sqrt(kept), rel=1e-3)


@pytest.mark.parametrize(("finest", "known"), [(2.0, True), (0.2, False)])
def test_a_coarse_profile_refuses_levels(tractor: Tractor, finest: float, known: bool) -> None:
    """At 8 m/s, the waves of a profile end at 16 Hz or at 1.6 Hz."""
    n = np.geomspace(0.01, finest, 30)
    spectrum = tuple(zip(n.tolist(), (256e-6 * (n / 0.1) ** -2.0).tolist(), strict=True))
    actual = tractor.levels(replace(CLASS_C, spectrum=spectrum), 140.0, 8.0)
    assert math.isnan(actual.velocity[0]) != known
    assert ("measured profile" in REASONS[actual.reason[0]]) != known
    # Lugs are the reason only where they end the waves before the profile does.
    for pitch, words in ((0.4 / finest, "measured profile"), (6.0, "lugs")):
        both = replace(CLASS_C, spectrum=spectrum, lug_pitch=pitch)
        reason = REASONS[tractor.levels(both, 140.0, 8.0).reason[0]]
        assert words in reason or (known and not reason)


@pytest.mark.parametrize(
    ("angle", "speed", "words"),
    [
        (89.9, 5.0, "angle is not known, or is outside"),
        (90.0, 5.0, ""),
        (180.0, 5.0, ""),
        (180.1, 5.0, "angle is not known, or is outside"),
        (math.nan, 5.0, "angle is not known, or is outside"),
        (120.0, math.nan, "ground speed is not known"),
        (120.0, -0.1, "ground speed is not known"),
        (120.0, math.inf, "ground speed is not known"),
        (120.0, 100.1, "ground speed is not known"),
        (120.0, 100.0, ""),
        (120.0, 0.0, ""),
        (120.0, 1e-9, ""),
    ],
)
def test_what_is_not_known_has_a_reason(
    tractor: Tractor, angle: float, speed: float, words: str
) -> None:
    """Angles outside the table and unknown speeds have no level; standing still nothing shakes."""
    actual = tractor.levels(replace(CLASS_C, roughness=1e-6), angle, speed)
    assert words in REASONS[actual.reason[0]]
    assert bool(REASONS[actual.reason[0]]) == bool(words)
    assert math.isnan(actual.velocity[0]) == bool(words)
    assert math.isnan(actual.off_ground_share[0]) == bool(words)
    if speed == 0.0:
        assert actual.velocity[0] == actual.forces2[0, 0] == actual.off_ground_share[0] == 0.0


def test_angles_and_speeds_of_different_numbers(tractor: Tractor) -> None:
    """Two angles and three speeds are refused; one speed counts for all angles."""
    lookup = GroundTable(tractor.table, tractor.mechanism, CLASS_C)
    with pytest.raises(GroundError, match="2 angles do not belong to 3 speeds; give one for each"):
        lookup.at(np.array([1.6, 2.0]), np.array([3.0, 4.0, 5.0]))
    assert len(lookup.at(np.array([1.6, 2.0]), np.array([3.0])).velocity) == 2


def test_mechanisms_and_terrains_that_have_no_level(tractor: Tractor) -> None:
    """Without a base or with one mount, in the soil, and above the band of the table."""
    mechanism, base = tractor.mechanism, tractor.mechanism.base
    assert base is not None
    first = replace(mechanism, base=replace(base, mounts=base.mounts[:1]))
    cases = (
        (replace(mechanism, base=None), CLASS_C, "no base on two or more mounts"),
        (first, CLASS_C, "no base on two or more mounts"),
        (mechanism, replace(CLASS_C, raised=False), "in the soil"),
        (mechanism, replace(CLASS_C, band=(0.3, 200.1)), "no FRFs"),
        (mechanism, replace(CLASS_C, band=(0.3, 200.0)), ""),
    )
    for changed, terrain, words in cases:
        lookup = GroundTable(tractor.table, changed, terrain, [CYLINDERS])
        values = lookup.at(np.array([2.0]), np.array([8.0]))
        assert words in REASONS[values.reason[0]]
        assert math.isnan(values.velocity[0]) == bool(words)
        assert values.forces2.shape == (1, 1)
    unloaded = replace(tractor.table, forces=(), static_forces=np.empty(0))
    values = GroundTable(unloaded, mechanism, CLASS_C).at(np.array([2.0]), np.array([8.0]))
    assert "static loads of the mounts are not known" in REASONS[values.reason[0]]


@pytest.mark.parametrize(
    ("ratio", "known"), [pytest.param(0.00155, True, marks=pytest.mark.nightly), (0.00152, False)]
)
def test_resonances_that_4096_lines_do_not_show_have_no_level(
    tractor: Tractor, ratio: float, known: bool
) -> None:
    """Lines are so close that a half-width has 1.5 steps: ln(20 / 0.3) / 4096 is 0.00103."""
    ratios = np.where(np.arange(6) == 2, ratio, tractor.table.damping_ratios)
    changed = replace(tractor, table=replace(tractor.table, damping_ratios=ratios))
    actual = changed.levels(replace(CLASS_C, roughness=1e-6), 120.0, 5.0)
    assert ("damping ratio" in REASONS[actual.reason[0]]) != known
    assert math.isnan(actual.velocity[0]) != known


@pytest.mark.nightly(short="test_levels_are_those_of_the_unreduced_model")
def test_lightly_damped_tyres_have_the_level_of_many_lines(tractor: Tractor) -> None:
    """With a tenth of their damping, 2048 lines differ by less than 1e-3 from 200,001."""
    shipped = tractor.mechanism.base
    assert shipped is not None
    mounts = tuple(replace(m, damping=(0.1 * m.damping[0], 400.0)) for m in shipped.mounts)
    mechanism = replace(tractor.mechanism, base=replace(shipped, mounts=mounts), uncertainty=None)
    model = LinkageModel(mechanism)
    table = build_table(model, 1e-4, ["E1", "rear_axle", "front_axle"])
    speed, alpha3, fine = 2.0, math.radians(133.3), np.linspace(0.3, 20.0, 200_001)
    w = 2.0 * math.pi * fine
    inputs = [("rear_axle", "z"), ("front_axle", "z")]
    rear, front = model.solve(alpha3).frf([("E1", "z")], inputs).frf(fine)[:, 0].T
    front *= 600.0e3 + 1j * w * 400.0
    rear *= (700.0e3 + 1j * w * 400.0) * np.exp(-1j * w * 2.5 / speed)
    density = np.abs(w * (front + rear)) ** 2 * 1e-6 * (fine / speed / 0.1) ** -2.0 / speed
    values = GroundTable(table, mechanism, replace(CLASS_C, roughness=1e-6)).at(
        np.array([alpha3]), np.array([speed])
    )
    assert values.velocity[0] == pytest.approx(math.sqrt(trapezoid(density, fine)), rel=1e-3)


def test_one_row_equals_many(tractor: Tractor) -> None:
    """Each number of many rows is that of one row to the last bit."""
    rng = np.random.default_rng(3)
    alpha3, speeds = rng.uniform(1.5, 3.2, 200), rng.uniform(-0.5, 20.0, 200)
    lookup = GroundTable(tractor.table, tractor.mechanism, CLASS_C, [CYLINDERS])
    many = lookup.at(alpha3, speeds)
    for i in range(200):
        values = lookup.at(alpha3[i : i + 1], speeds[i : i + 1])
        for name in ("velocity", "acceleration", "forces2", "off_ground_share", "reason"):
            np.testing.assert_array_equal(
                getattr(values, name)[..., 0], getattr(many, name)[..., i]
            )
    single = lookup.at(2.3, 5.0)
    assert (single.velocity, single.reason) == (
        lookup.at(np.array([2.3]), np.array([5.0])).velocity,
        0,
    )
    rest = lookup.at(np.array([2.3, 2.4]), -0.0)
    assert (rest.velocity == 0.0).all()
    assert (rest.reason == 0).all()


@pytest.mark.parametrize(
    ("minutes", "cases", "least", "largest"),
    [(2.0, 2, 0.02, 0.07), pytest.param(10.0, 4, 0.0, 0.035, marks=pytest.mark.nightly)],
)
def test_levels_are_those_of_a_simulation_in_time(
    minutes: float, cases: int, least: float, largest: float
) -> None:
    """They differ by less than two standard errors, at two angles and speeds or all four cases.

    All modal coordinates are integrated under a profile that passes both axles, one later.
    """
    simulation = pytest.importorskip("benchmark.ground", reason="it needs exudyn")
    for _, _, ratios, off, share in simulation.in_modes(minutes, simulation.CASES[:cases]):
        for ratio, error in ratios:
            assert least < error < largest
            assert abs(ratio - 1.0) < 2.0 * error
        assert abs(off - share) < 0.02
