# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads materials, and refuses those whose numbers suggest another unit."""

from linkage_vibration.mechanics.description import Material
from linkage_vibration.mechanics.keys import CheckedMapping

_SOFTEST = 1e6  # Pa, of rubber; the moduli of metals in N/mm2 are lower
_STIFFEST = 1e18  # Pa; beside a stiffer link, rounding moves the first mode by more than 1e-5
_LIGHTEST = 1e-9  # kg/m3; below, products of masses become zero
_STIFF, _FLIMSY = 1e9, (0.5, 25.0)  # Pa, and kg/m3 that no solid so stiff has; in g/cm3 all have


def read_material(keys: CheckedMapping) -> Material:
    """Read an isotropic material."""
    poisson = keys.number("poisson_ratio")
    if not -1.0 < poisson < 0.5:
        raise keys.error("poisson_ratio", f"{poisson:g} is not between -1 and 0.5; steel has 0.3.")
    hint = "write it in Pa (steel: 210.0e+9), and describe what is rigid under rigid_bodies"
    modulus = keys.number("youngs_modulus", least=_SOFTEST, most=_STIFFEST, hint=hint)
    hint = "write it in kg/m3 (steel: 7800.0; 0.001 for a link without mass)"
    density = keys.number("density", positive=True, least=_LIGHTEST, hint=hint)
    if modulus > _STIFF and _FLIMSY[0] < density < _FLIMSY[1]:
        raise keys.error("density", f"no such solid weighs {density:g} kg/m3; {hint}.")
    return Material(modulus, density, poisson)
