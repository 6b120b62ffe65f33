# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Straight links as Timoshenko beams in the plane: matrices of a free-free chain of elements.

The element is the two-node one that is exact in statics (Przemieniecki 1968), with the consistent
mass that belongs to the same displacement field, rotary inertia included (Friedman and Kosmatka
1993). Each node has three DoFs: displacement u along the link, w across it, rotation theta from x
towards z.
"""

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.description import Link, Material, Section

FloatArray = NDArray[np.float64]

DOFS_PER_NODE = 3


def element_matrices(
    length: float, section: Section, material: Material
) -> tuple[FloatArray, FloatArray]:
    """Mass and stiffness of one element.

    Parameters
    ----------
    length : float
        m.
    section, material : Section, Material
        Of the element.

    Returns
    -------
    mass, stiffness : ndarray, (6, 6)
        In the order u, w, theta of the first node, then of the second; SI.

    Examples
    --------
    A bar's end moves by F L / (E A) when the other end is held:

    >>> from linkage_vibration.mechanics.description import rectangle
    >>> steel = Material(210e9, 7800.0, 0.3)
    >>> _, k = element_matrices(2.0, rectangle(0.01, 0.02, 0.3), steel)
    >>> float(round(1 / k[3, 3] * 210e9 * 2e-4, 12))
    2.0
    """
    area, inertia = section.area, section.second_moment
    rigidity = material.youngs_modulus * inertia
    shear = section.shear_coefficient * area * material.shear_modulus
    phi = 12.0 * rigidity / (shear * length**2)  # shear over bending flexibility

    mass, stiffness = np.zeros((6, 6)), np.zeros((6, 6))
    axial = np.ix_([0, 3], [0, 3])
    bending = np.ix_([1, 2, 4, 5], [1, 2, 4, 5])
    stiffness[axial] = material.youngs_modulus * area / length * np.array([[1, -1], [-1, 1]])
    stiffness[bending] = (
        rigidity / (length**3 * (1 + phi)) * _bending(12, 6, 4 + phi, 2 - phi, length)
    )

    line_mass = material.density * area
    mass[axial] = line_mass * length / 6.0 * np.array([[2, 1], [1, 2]])
    a = 70 * phi**2 + 147 * phi + 78
    b = (35 * phi**2 + 77 * phi + 44) * length / 4
    c = 35 * phi**2 + 63 * phi + 27
    d = (35 * phi**2 + 63 * phi + 26) * length / 4
    e = (7 * phi**2 + 14 * phi + 8) * length**2 / 4
    f = (7 * phi**2 + 14 * phi + 6) * length**2 / 4
    translation = np.array([[a, b, c, -d], [b, e, d, -f], [c, d, a, -b], [-d, -f, -b, e]])
    g = (3 - 15 * phi) * length
    h = (10 * phi**2 + 5 * phi + 4) * length**2
    i = (5 * phi**2 - 5 * phi - 1) * length**2
    turning = np.array([[36, g, -36, g], [g, h, -g, i], [-36, -g, 36, -g], [g, i, -g, h]])
    mass[bending] = (
        line_mass * length / 210.0 * translation
        + material.density * inertia / (30.0 * length) * turning
    ) / (1 + phi) ** 2
    return mass, stiffness


def link_matrices(link: Link) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mass and stiffness of a link as a free-free chain of equal elements between its points.

    Parameters
    ----------
    link : Link
        Its ``elements`` are shared out among the spans between points by their length, at least
        one each; its ``count`` multiplies both matrices.

    Returns
    -------
    mass, stiffness : ndarray, (3 n_nodes, 3 n_nodes)
        SI; DoFs u, w, theta node by node.
    nodes : ndarray, (n_nodes,)
        Places along the link, m; every point of the link is one of them.
    """
    nodes = _nodes(link)
    n = DOFS_PER_NODE * len(nodes)
    mass, stiffness = np.zeros((n, n)), np.zeros((n, n))
    for i, length in enumerate(np.diff(nodes)):
        at = slice(DOFS_PER_NODE * i, DOFS_PER_NODE * (i + 2))
        element_mass, element_stiffness = element_matrices(length, link.section, link.material)
        mass[at, at] += element_mass
        stiffness[at, at] += element_stiffness
    return link.count * mass, link.count * stiffness, nodes


def _bending(a: float, b: float, c: float, d: float, length: float) -> FloatArray:
    b, c, d = b * length, c * length**2, d * length**2
    return np.array([[a, b, -a, b], [b, c, -b, d], [-a, -b, a, -b], [b, d, -b, c]])


def _nodes(link: Link) -> FloatArray:
    places = [x for _, x in link.points]
    total = places[-1] - places[0]
    nodes = [np.array(places[:1])]
    for start, end in zip(places, places[1:], strict=False):
        count = max(1, round(link.elements * (end - start) / total))
        nodes.append(np.linspace(start, end, count + 1)[1:])
    return np.concatenate(nodes)
