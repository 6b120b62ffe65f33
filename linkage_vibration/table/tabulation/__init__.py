# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Builds the lookup table: the model is solved only where the error of the table requires it.

`building` divides the stroke into pieces. For each, `refinement` gets solutions of the model from
`sampling` and the modes through them from `tracking`, until their polynomials meet the tolerance
(`accuracy`); `peaks` finds which maxima are the highest. `assembly` makes the table from the
pieces, and compares it with the model.

Where damping couples the modes, `coupled` refines the pieces instead. It follows the poles by their
subspaces (`subspaces`), bounds the errors of the reduced models on these, and divides each piece
into cells for lookups (`cell_making`).
"""

from linkage_vibration.table.tabulation.accuracy import TOLERANCE
from linkage_vibration.table.tabulation.building import build_table

__all__ = ["TOLERANCE", "build_table"]
