# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads excitations from YAML files."""

from pathlib import Path

from linkage_vibration.prediction.excitation import Excitation, excitations_from_mapping
from linkage_vibration.readers.mechanism import load_yaml


def read_excitations(path: Path) -> tuple[Excitation, ...]:
    """Read and validate the excitations of a linkage.

    An ExcitationError names the file, the key and the fix.
    """
    return excitations_from_mapping(load_yaml(path)[0], f"{path}: excitations")
