# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Linkages without their lateral half, for what is about motions in the plane alone."""

import copy
from functools import cache
from typing import Any

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import load_yaml, mechanism_of
from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation import build_table

IN_PLANE = "The key `lateral` of mechanisms and the deviations that belong to it are left out."


def in_plane(mapping: Any) -> Any:
    """Return a description without `lateral` and without the deviations that only it needs."""
    mapping = copy.deepcopy(mapping)
    if mapping.pop("lateral", None):
        for kind in ("relative", "absolute"):
            numbers = mapping.get("uncertainty", {}).get(kind, {})
            for path in [p for p in numbers if p.startswith("lateral.") or p.endswith(".track")]:
                del numbers[path]
    return mapping


def plane_mechanism(file: str = DEFAULT_MECHANISM) -> Mechanism:
    """Return a mechanism of `config` without its lateral half."""
    return mechanism_of(in_plane(load_yaml(config_file(file))[0]), config_file(file))


@cache
def plane_table() -> Table:
    """Return the table of the shipped tractor without its lateral half."""
    return build_table(LinkageModel(plane_mechanism()))
