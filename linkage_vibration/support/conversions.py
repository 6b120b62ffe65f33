# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Hands results over to xarray and to Matplotlib, which are imported when they are needed."""

from importlib import import_module
from typing import Any

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.support.missing_library import needed


def import_xarray() -> Any:
    """Return the module xarray; an error says how to install it."""
    with needed("xarray", "A dataset needs xarray", LinkageVibrationError):
        return import_module("xarray")


def public_plot(source: object, picture: Any) -> Any:
    """Draw what a method `plot` belongs to, by `linkage_vibration.plot`."""
    return import_module("linkage_vibration").plot(source, picture)
