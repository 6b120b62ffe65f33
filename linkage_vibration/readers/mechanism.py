# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Mechanisms from YAML files."""

from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

from linkage_vibration.mechanics.description import (
    Mechanism,
    MechanismError,
    mechanism_from_mapping,
)


def read_mechanism(path: Path) -> Mechanism:
    """Read and validate a mechanism.

    Parameters
    ----------
    path : Path
        YAML file; ``config/three_point_linkage.yaml`` shows every key.

    Raises
    ------
    MechanismError
        If the file cannot be read, is not YAML, or describes no sound mechanism; the text names
        the file, the key and the mend.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise MechanismError(
            str(path), f"cannot be read ({error.strerror}); give the path of a YAML file."
        ) from None
    except UnicodeDecodeError:
        raise MechanismError(str(path), "is not text in UTF-8; give a YAML file.") from None
    return parse_mechanism(text, str(path))


def parse_mechanism(text: str, source: str) -> Mechanism:
    """Validate the text of a YAML file; ``source`` names it in errors.

    Raises
    ------
    MechanismError
        As `read_mechanism`.
    """
    try:
        mapping = yaml.load(text, _StrictLoader)
    except yaml.YAMLError as error:
        raise MechanismError(source, f"is not valid YAML: {_one_line(error)}") from None
    except (ValueError, RecursionError) as error:
        raise MechanismError(source, f"cannot be read as YAML: {error}") from None
    try:
        return mechanism_from_mapping(mapping)
    except MechanismError as error:
        raise MechanismError(f"{source}: {error.path}", error.problem) from None


class _StrictLoader(yaml.SafeLoader):
    """Plain data only, and no key twice: YAML would drop the first in silence."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = key_node.value
            if isinstance(key, str) and key_node.tag != "tag:yaml.org,2002:merge":
                if key in seen:
                    raise yaml.constructor.ConstructorError(
                        None, None, f"the key {key!r} stands twice", key_node.start_mark
                    )
                seen.add(key)
        return super().construct_mapping(node, deep)


def _one_line(error: yaml.YAMLError) -> str:
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        return f"line {error.problem_mark.line + 1}: {error.problem}."
    return " ".join(str(error).split())
