# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Sections against tables, limits and an independent series."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from linkage_vibration.mechanics.sections.i_section import i_section
from linkage_vibration.mechanics.sections.rectangle import rectangle
from linkage_vibration.mechanics.sections.tube import tube


def test_rectangle() -> None:
    """Height counts in the plane, width across it, with Cowper's coefficient."""
    section = rectangle(0.02, 0.06, 0.3)
    assert section.area == pytest.approx(1.2e-3)
    assert section.second_moment == pytest.approx(3.6e-7)
    assert section.turned.second_moment == pytest.approx(4e-8)
    assert section.turned.shear_coefficient == section.shear_coefficient
    assert section.shear_coefficient == pytest.approx(13 / 15.3)
    assert rectangle(0.02, 0.06, 0.0).shear_coefficient == pytest.approx(5 / 6)


def test_round_bar() -> None:
    """A tube with no hole is a round bar, with Cowper's 6 (1 + nu) / (7 + 6 nu)."""
    bar, radius = tube(0.03, 0.0, 0.3), 0.015
    assert bar.area == pytest.approx(math.pi * radius**2)
    assert bar.second_moment == pytest.approx(math.pi * radius**4 / 4)
    assert bar.turned == bar
    assert bar.shear_coefficient == pytest.approx(7.8 / 8.8)


def test_thin_tube() -> None:
    """A thin tube has Cowper's 2 (1 + nu) / (4 + 3 nu)."""
    radius, wall = 0.05, 1e-6
    section = tube(2 * radius + wall, 2 * radius - wall, 0.3)
    assert section.area == pytest.approx(2 * math.pi * radius * wall)
    assert section.shear_coefficient == pytest.approx(2.6 / 4.9)


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.3])
def test_i_section_with_a_web_as_wide_as_its_flanges(poisson_ratio: float) -> None:
    """It is a full rectangle."""
    section = i_section(0.09, 0.04, 0.04, 0.02, poisson_ratio)
    full = rectangle(0.04, 0.09, poisson_ratio)
    for name in ("area", "second_moment", "shear_coefficient"):
        assert getattr(section, name) == pytest.approx(getattr(full, name), rel=1e-12)
    assert section.second_moment_across == pytest.approx(full.second_moment_across, rel=1e-12)


def test_i_section_with_thin_walls() -> None:
    """Its shear coefficient approaches that of Cowper's thin-walled formula, with nu = 0."""
    height, width, web, flange = 1.0, 0.6, 1e-4, 2e-4
    m, n = 2.0 * width * flange / (height * web), width / height
    below = 12.0 + 72.0 * m + 150.0 * m**2 + 90.0 * m**3 + 30.0 * n**2 * (m + m**2)
    section = i_section(height + flange, width, web, flange, 0.0)
    expected = 10.0 * (1.0 + 3.0 * m) ** 2 / below
    assert section.shear_coefficient == pytest.approx(expected, rel=2e-3)
    assert section.area == pytest.approx(2.0 * width * flange + height * web, rel=1e-3)


@pytest.mark.parametrize(
    ("height", "width", "web", "flange"),
    [(0.1, 0.055, 0.0041, 0.0057), (0.2, 0.1, 0.0056, 0.0085), (0.1, 0.1, 0.006, 0.01)],
)
def test_i_section_against_elasticity(
    height: float, width: float, web: float, flange: float
) -> None:
    """The section of rolled profiles, by finite elements of Saint-Venant's flexure."""
    section = i_section(height, width, web, flange, 0.3)
    area, second, shear = elastic_section(height, width, web, flange, 0.3)
    assert section.area == pytest.approx(area, rel=1e-9)
    assert section.second_moment == pytest.approx(second, rel=1e-9)
    assert 1.0 <= section.shear_coefficient / shear <= 1.07


def elastic_section(
    height: float, width: float, web: float, flange: float, nu: float
) -> tuple[float, float, float]:
    """Return area, second moment and Cowper's coefficient.

    The coefficient is 2 (1 + nu) I / (nu (I' - I) / 2 - A / I integral of x (chi + x y^2)) with
    the flexure function chi of Saint-Venant's cantilever (Cowper 1966, eq. 26).
    """
    skfem = pytest.importorskip("skfem", reason="scikit-fem solves the flexure")
    helpers = pytest.importorskip("skfem.helpers")
    dot, grad = helpers.dot, helpers.grad

    def cuts(*places: float) -> list[float]:
        spans = [np.linspace(a, b, 4 if b - a < 0.02 else 12) for a, b in pairwise(places)]
        return np.unique(np.round(np.concatenate(spans), 12)).tolist()

    x = cuts(-height / 2, flange - height / 2, 0.0, height / 2 - flange, height / 2)
    y = cuts(-width / 2, -web / 2, 0.0, web / 2, width / 2)
    mesh = skfem.MeshQuad.init_tensor(np.array(x), np.array(y))
    middle = mesh.p[:, mesh.t].mean(axis=1)
    inside = (np.abs(middle[0]) > height / 2 - flange) | (np.abs(middle[1]) < web / 2)
    mesh = mesh.restrict(np.flatnonzero(inside))
    inner, edge = (kind(mesh, skfem.ElementQuad2()) for kind in (skfem.Basis, skfem.FacetBasis))
    laplace = skfem.BilinearForm(lambda u, v, _: dot(grad(u), grad(v))).assemble(inner)

    def harmonic(slope: Any) -> Any:
        load = skfem.LinearForm(lambda v, w: slope(*w.x, *w.n) * v).assemble(edge)
        return skfem.solve(*skfem.condense(laplace, load, D=np.array([0])))

    def integral(term: Any, chi: Any) -> float:
        form = skfem.Functional(lambda w: term(*w.x, w["chi"]))
        return float(form.assemble(inner, chi=inner.interpolate(chi)))

    chi = harmonic(
        lambda x, y, nx, ny: -nx * (nu * x**2 / 2 + (1 - nu / 2) * y**2) - ny * (2 + nu) * x * y
    )
    area = integral(lambda x, y, c: 0.0 * x + 1.0, chi)
    second, out = (integral(lambda x, y, c, i=i: (x, y)[i] ** 2, chi) for i in (0, 1))
    bent = integral(lambda x, y, c: x * (c + x * y**2), chi)
    shear = 2.0 * (1.0 + nu) * second / (nu / 2.0 * (out - second) - area / second * bent)
    return area, second, shear
