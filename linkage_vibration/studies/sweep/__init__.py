# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of many designs, evaluated at the same angles and written to one file.

`designs` reads a grid of designs, `building` builds their tables, and `output` is the file.
"""

from linkage_vibration.studies.sweep.building import SweepResult, sweep
from linkage_vibration.studies.sweep.designs import Designs, SweepError, read_designs

__all__ = ["Designs", "SweepError", "SweepResult", "read_designs", "sweep"]
