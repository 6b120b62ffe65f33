# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Cross-sections of beams from their dimensions, one kind in each file."""

from collections.abc import Callable

from linkage_vibration.mechanics.description import Section
from linkage_vibration.mechanics.keys import CheckedMapping
from linkage_vibration.mechanics.sections import general, i_section, rectangle, tube

SHAPES: dict[str, Callable[[CheckedMapping, float], Section]] = {
    "rectangle": rectangle.read,
    "tube": tube.read,
    "round": tube.read_round,
    "i_section": i_section.read,
    "general": general.read,
}
"""What reads a section from its keys and Poisson's ratio, by the ``shape`` that the keys name."""
