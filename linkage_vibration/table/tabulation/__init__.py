# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Builds the lookup table: the model is solved where the table's error asks for it, and no more.

`building` cuts the stroke into pieces. For each, `refinement` asks `sampling` for solutions of the
model and `tracking` for the modes that run through them, until their polynomials meet the tolerance
(`accuracy`); `veering` looks at what seem to be crossings, `peaks` at which maxima are the highest.
`assembly` makes the table of the pieces, and `verification` holds it against the model.
"""

from linkage_vibration.table.tabulation.accuracy import TOLERANCE
from linkage_vibration.table.tabulation.building import build_table

__all__ = ["TOLERANCE", "build_table"]
