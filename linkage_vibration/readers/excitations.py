# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Excitations from YAML files."""

from pathlib import Path

from linkage_vibration.prediction.excitation import Excitation, excitations_from_mapping
from linkage_vibration.readers.mechanism import load_yaml


def read_excitations(path: Path) -> tuple[Excitation, ...]:
    """Read and validate what excites a linkage.

    Parameters
    ----------
    path : Path
        YAML file; ``config/excitations.yaml`` shows every key.

    Raises
    ------
    MechanismError
        If the file cannot be read, or is not YAML.
    ExcitationError
        If it describes no sound excitations; the text names the file, the key and the mend.
    """
    return excitations_from_mapping(load_yaml(path)[0], f"{path}: excitations")
