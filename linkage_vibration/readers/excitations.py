# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads excitations from YAML files."""

from pathlib import Path
from typing import Any

from linkage_vibration.prediction.excitation import Excitation, excitations_from_mapping
from linkage_vibration.prediction.provenance import EXCITATIONS
from linkage_vibration.readers.mechanism import load_yaml
from linkage_vibration.readers.profiles import read_spectra


def read_excitations(path: Path) -> tuple[Excitation, ...]:
    """Read the excitations of a linkage, and the profile of a terrain from a file beside them."""
    return excitations_from_mapping(
        load_yaml(path)[0], f"{path}: excitations", lambda name: read_spectra(path.parent / name)
    )


def excitation_files(path: Path) -> dict[str, bytes]:
    """Return a valid file of excitations, and the profile that it names, as a log attaches them."""
    content: dict[str, dict[str, Any]] = load_yaml(path)[0]
    grounds = [entry["terrain"] for entry in content.values() if "terrain" in entry]
    names = [ground["profile"] for ground in grounds if "profile" in ground]
    profiles = {name: (path.parent / name).read_bytes() for name in names}
    return {EXCITATIONS: path.read_bytes()} | profiles
