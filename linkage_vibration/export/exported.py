# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What one export contains: a table, its numbers, and how its names begin."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from linkage_vibration.export.constants import Constants, ExportError, constants_of
from linkage_vibration.export.orders import orders_of
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.levels import kept_levels
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.table.table import Table

NAME = "linkage_vibration"
"""How names begin unless another name is wanted."""

_VALID_NAME = re.compile(r"[a-z][0-9a-z_]{0,19}")
_EQUAL = "The numbers are those of the table, to the last bit."
_LOAD_RATIOS = (
    " Load ratios come from numbers of their own in single precision, of which each differs by at "
    "most 1 % of its largest value."
)


@dataclass(frozen=True, eq=False)
class Export:
    """A table to export."""

    name: str  # begins the names of files and of everything in C
    table: Table
    constants: Constants

    @property
    def mode_labels(self) -> list[str]:
        """How the modes are called, (n_modes,)."""
        return [self.table.mode_label(mode) for mode in range(self.table.n_modes)]

    @property
    def accuracy(self) -> str:
        """Sentences about how the numbers differ from those of the table."""
        orders = self.constants.orders
        return f"{_EQUAL}{_LOAD_RATIOS if orders and orders.forces else ''}"


def export_of(
    table: Table,
    mechanism: Mechanism | None = None,
    excitations: Sequence[Excitation] = (),
    *,
    name: str = NAME,
) -> Export:
    """Return what to export; an ExportError refuses names that C may not tell apart."""
    if not _VALID_NAME.fullmatch(name):
        raise ExportError(
            f"{name!r} cannot begin names in C; give up to 20 lower-case letters, digits and "
            "underscores, of which the first is a letter."
        )
    orders = None
    if mechanism is not None and excitations:
        levels = kept_levels(Predictor(table), mechanism, excitations)
        for each in excitations:
            if each.load is not None and each.load.across:
                problem = f"excitation {each.name} acts across the plane"
                raise ExportError(f"{problem}, which exports leave out; remove its amplitude.")
        orders = orders_of(table, levels, excitations)
    return Export(name, table, constants_of(table, orders))
