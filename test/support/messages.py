# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of any reader in one plain form, for comparisons."""

from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """Return a decoded message of any reader as dicts, lists and numbers; NaN as a string."""
    # Constants have capital letters; additions of a reader begin with an underscore.
    for names in (getattr(value, "__slots__", ()), getattr(value, "__dataclass_fields__", ())):
        if fields := [name for name in names if name.islower() and name[0] != "_"]:
            return {name: plain(getattr(value, name)) for name in fields}
    if isinstance(value, np.ndarray | list | tuple):
        return [plain(item) for item in value]
    return "NaN" if value != value else value
