# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Builds the lookup table: the model is solved only where the error of the table requires it.

`building` divides the stroke into pieces. For each, `piece_refinement` gets poles from `sampling`,
follows them by their subspaces (`subspaces`), and bounds the errors of the reduced models on these,
until they meet the tolerance (`accuracy`). `cell_making` divides each piece into cells for lookups.
"""

from linkage_vibration.table.tabulation.accuracy import TOLERANCE
from linkage_vibration.table.tabulation.building import build_table

__all__ = ["TOLERANCE", "build_table"]
