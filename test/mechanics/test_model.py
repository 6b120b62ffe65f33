# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The whole linkage: against the unreduced assembly, the rigid-body limit, published trends."""

import math
from dataclasses import replace

import numpy as np
import pytest

from linkage_vibration.mechanics.bodies.beam import Beam
from linkage_vibration.mechanics.description import (
    Damping,
    Link,
    LossFactor,
    Material,
    Mechanism,
    ModalRatio,
    Rayleigh,
)
from linkage_vibration.mechanics.kinematics import Kinematics, KinematicsError
from linkage_vibration.mechanics.model import LinkageModel, ModelError
from linkage_vibration.mechanics.response import PoleResidue

ANGLES_DEG = (90.0, 110.0, 140.0, 168.0, 180.0)


@pytest.mark.parametrize("which", ["mechanism", "printed"])
def test_reduced_equals_unreduced(which: str, request: pytest.FixtureRequest) -> None:
    """20 modes a link give modes 1 to 3 within 1e-5 of the full matrices, from above."""
    mechanism = request.getfixturevalue(which)
    reduced, full = LinkageModel(mechanism), LinkageModel(mechanism, reduced=False)
    assert len(full.system.mass) > 3 * len(reduced.system.mass) / 2
    for angle in np.radians(ANGLES_DEG):
        frequencies = reduced.solve(angle).natural_frequencies[:3]
        exact = full.solve(angle).natural_frequencies[:3]
        np.testing.assert_allclose(frequencies, exact, rtol=1e-5)
        assert (frequencies >= exact * (1 - 1e-9)).all()


def made_of(link: Link, material: Material) -> Link:
    """Return a link of another material."""
    assert isinstance(link.body, Beam)
    return replace(link, body=replace(link.body, material=material))


@pytest.mark.parametrize(
    ("alpha3_deg", "inertia"), [(90.0, 165.1), (140.0, 194.9), (168.0, 123.9), (180.0, 86.8)]
)
def test_rigid_body_limit(mechanism: Mechanism, alpha3_deg: float, inertia: float) -> None:
    """With light links, rigid but for the crank, the crank is the spring of one oscillator.

    The lift rod pulls at the crank's end at an angle b to it. The end gives way across the crank
    by L^3 / (3 E I) + L / (kappa A G) and along it by L / (E A), so about alpha3 the spring is
    k = (L sin b)^2 / (c_across sin^2 b + c_along cos^2 b), and w^2 = k / J with the implement's
    J = m (dx^2 + dz^2) + I dtheta^2 by the velocity ratios. J is also what a prototype found.
    """
    crank = mechanism.links[2]
    light, rigid = Material(210e9, 1e-3, 0.3), Material(210e15, 1e-3, 0.3)
    links = tuple(made_of(link, light if link is crank else rigid) for link in mechanism.links)
    limit = replace(mechanism, links=links)
    configuration = Kinematics(limit).at(math.radians(alpha3_deg))
    body = limit.rigid_bodies[0]
    velocity = configuration.place_rate(body.name, body.centre_of_gravity)
    ratio = configuration.velocity_ratio(body.name)
    generalised = body.mass * float(velocity @ velocity) + body.inertia * ratio**2
    assert generalised == pytest.approx(inertia, rel=5e-4)

    assert isinstance(crank.body, Beam)
    section, length = crank.body.segments[0].section, crank.points[-1][1][0]
    shear = section.shear_coefficient * section.area * light.shear_modulus
    across = length**3 / (3 * light.youngs_modulus * section.second_moment) + length / shear
    along = length / (light.youngs_modulus * section.area)
    pull = configuration.angle("lift_rod") - math.radians(alpha3_deg)
    give = (across * math.sin(pull) ** 2 + along * math.cos(pull) ** 2) / crank.count
    spring = (length * math.sin(pull)) ** 2 / give
    expected = math.sqrt(spring / generalised) / (2 * math.pi)
    frequencies = LinkageModel(limit).solve(math.radians(alpha3_deg)).natural_frequencies[0]
    assert frequencies == pytest.approx(expected, rel=1e-5)


def test_trends_of_the_paper(model: LinkageModel) -> None:
    """Mode 1 rises over the stroke and modes 2 and 3 fall from end to end, as published."""
    values = np.array([model.solve(a).natural_frequencies[:3] for a in np.radians(ANGLES_DEG)])
    assert (np.diff(values[:, 0]) > 0.0).all()
    assert values[-1, 1] < 0.7 * values[0, 1]
    assert (np.diff(values[:, 2]) < 0.0).all()


def test_published_frequencies_within_11_percent(model: LinkageModel) -> None:
    """The nine printed natural frequencies, with the assumed sections."""
    f90, f140, f180 = (
        model.solve(math.radians(a)).natural_frequencies[:3] for a in (90.0, 140.0, 180.0)
    )
    pairs = [
        (f90[0], 2.9),
        (f140[0], 4.3),
        (f180[0], 6.4),
        (f90[1], 105.9),
        (f140[1], 94.9),
        (f180[1], 57.8),
        (f140[2], 170.6),
        (f180[2], 152.8),
        (f90[2], 191.0),
    ]
    for each, printed in pairs:
        assert each == pytest.approx(printed, rel=0.11)


def test_printed_length_cannot_give_the_papers_curve(printed: Mechanism) -> None:
    """With 0.420 m the first frequency falls again past 168 deg: it has its top inside."""
    model = LinkageModel(printed)
    first = [model.solve(a).natural_frequencies[0] for a in np.radians([140.0, 168.0, 180.0])]
    assert first[1] > 2 * first[2]
    assert first[1] > first[0]


def test_unknown_places_are_reported(model: LinkageModel) -> None:
    """A response asked for at no point of the linkage names it."""
    with pytest.raises(ModelError, match="V1 has no direction y; use x or z, as"):
        model.solve(2.0).frf([("V1", "y")], [("V1", "z")])
    with pytest.raises(ModelError, match="no point E9"):
        model.solve(2.0).frf([("E9", "z")], [("E1", "z")])


@pytest.mark.parametrize("damping", [None, ModalRatio(0.01), LossFactor(0.02), Rayleigh(0.0, 0.0)])
def test_coupled_frf_at_and_near_zero(mechanism: Mechanism, damping: Damping | None) -> None:
    """At 0 Hz and below 0.1 Hz, where eq. 19 loses its digits: as the sum over modes, to 1e-8."""
    model = LinkageModel(replace(mechanism, damping=damping) if damping else mechanism)
    places = [("E1", "z"), ("E2", "x"), ("V1", "z")]
    frequencies = np.array([0.0, 1e-4, 1e-2, 0.3, 50.0])
    for angle in np.radians([90.0, 140.0, 180.0]):
        receptances = model.coupled_frf(angle, frequencies, places, places).values
        exact = model.solve(angle).frf(places, places).frf(frequencies)
        size = np.abs(exact).max(axis=(1, 2), keepdims=True)
        assert (np.abs(receptances - exact) < 1e-8 * size).all()
        assert (np.abs((receptances[1] - receptances[0]).real) < 1e-8 * size[0]).all()


def test_a_band_keeps_antiresonances_and_the_static_limit(model: LinkageModel) -> None:
    """Three modes alone err by 50 times at an antiresonance, by half at 0 Hz; a band by 1e-4."""
    places = [("E1", "z"), ("E1", "x"), ("E2", "x"), ("V1", "z")]
    lines, solution = np.linspace(0.0, 200.0, 2001), model.solve(math.radians(140.0))
    whole = solution.frf(places, places)
    exact = whole.frf(lines)
    nothing = np.zeros_like(whole.residual)
    few = PoleResidue(
        whole.stiffness[:3], whole.decay[:3], whole.residues[..., :3], whole.rates[..., :3], nothing
    )
    wrong = np.abs(few.frf(lines) / exact - 1.0)
    assert wrong.max() > 50.0
    assert wrong[0].max() > 0.5
    static = replace(few, residual=(whole.residues[..., 3:] / whole.stiffness[3:]).sum(axis=-1))
    np.testing.assert_allclose(static.frf(lines[:1]), exact[:1], rtol=1e-12)
    receptances = solution.frf(places, places, band=(0.0, 200.0)).frf(lines)
    np.testing.assert_allclose(receptances, exact, rtol=1e-4)


def test_a_stack_has_the_solutions_of_each_angle(model: LinkageModel) -> None:
    """Angles that are solved together have the poses, forces and modes of each solved alone."""
    angles = np.radians([90.0, 127.0, 180.0])
    stack, place = model.stack(angles), [(model.mechanism.response.point, "z")]
    forces = model.forces.at_rest(stack.configuration, stack.joining, stack.coupled)
    for i, (row, angle) in enumerate(zip(stack.rows, angles.tolist(), strict=True)):
        alone = model.solve(angle)
        np.testing.assert_allclose(row.configuration.angles, alone.configuration.angles, rtol=1e-13)
        np.testing.assert_allclose(row.natural_frequencies, alone.natural_frequencies, rtol=1e-9)
        np.testing.assert_allclose(row.damping_ratios, alone.damping_ratios, rtol=1e-9)
        moved, expected = np.abs(stack.participation(place)[i]), np.abs(alone.participation(place))
        np.testing.assert_allclose(moved, expected, rtol=1e-6, atol=1e-9)
        at_rest = model.forces.at_rest(alone.configuration, alone.joining)
        np.testing.assert_allclose(forces[i], at_rest, rtol=1e-9, atol=1e-9 * np.abs(at_rest).max())
    with pytest.raises(ModelError, match="take one of its `rows`"):
        stack.shape(0)


def test_a_dataset_of_a_stack(model: LinkageModel) -> None:
    """Its natural frequencies are those of each angle solved alone, along the dimension alpha3."""
    pytest.importorskip("xarray", reason="xarray is not installed")
    angles = np.radians([90.0, 180.0])
    data = model.stack(angles).to_xarray()
    expected = [model.solve(angle).natural_frequencies for angle in angles.tolist()]
    frequencies = data.natural_frequencies.transpose("alpha3", "mode")
    np.testing.assert_allclose(frequencies, expected, rtol=1e-9)
    np.testing.assert_allclose(data.alpha3, angles)


def test_a_stack_refuses_the_first_angle_that_does_not_close(model: LinkageModel) -> None:
    """Among angles that close, one that does not is refused by the sentence of `solve`."""
    beyond = math.radians(204.0)  # The toggle is at 203.70 deg.
    with pytest.raises(KinematicsError) as alone:
        model.solve(beyond)
    with pytest.raises(KinematicsError) as together:
        model.stack(np.array([1.6, beyond, 4.0]))
    assert str(together.value) == str(alone.value)
    assert model.stack(np.array([1.6, math.radians(203.6)])).vectors.ndim == 3
