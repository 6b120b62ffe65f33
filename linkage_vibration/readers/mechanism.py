# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads mechanisms from YAML files."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from linkage_vibration.mechanics.description import Body, Mechanism, MechanismError, Point
from linkage_vibration.mechanics.keys import CheckedMapping
from linkage_vibration.mechanics.parsing import mechanism_from_mapping, with_values
from linkage_vibration.readers.component_files import ComponentFileError
from linkage_vibration.readers.frfs import read_frfs
from linkage_vibration.readers.matrices import read_matrices
from linkage_vibration.support.atomic_files import read_text
from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file
from linkage_vibration.support.strict_yaml import load_yaml_text


def read_mechanism(path: str | Path | None = None) -> Mechanism:
    """Read and validate a mechanism.

    Parameters
    ----------
    path : str or Path, optional
        The YAML file. Paths in it are relative to its folder. By default, the three-point
        linkage that comes with the package.

    Raises
    ------
    MechanismError
        If the file, or a file that it names, cannot be read or is invalid; the text names the
        file, the key and how to fix it.
    """
    path = config_file(DEFAULT_MECHANISM) if path is None else Path(path)
    return mechanism_of(load_yaml(path)[0], path)


def load_yaml(path: Path) -> tuple[Any, str]:
    """Return the data of a YAML file, and its text; a MechanismError says why it cannot be read."""
    try:
        text = read_text(path)
    except OSError as error:
        problem = f"cannot be opened: {error.strerror}; give the path of a YAML file."
        raise MechanismError(str(path), problem) from None
    except UnicodeDecodeError:
        raise MechanismError(str(path), "is not text in UTF-8; give a YAML file.") from None
    except ValueError:  # a null character
        problem = "is not a path; give the path of a YAML file."
        raise MechanismError(repr(str(path)), problem) from None
    try:
        return load_yaml_text(text), text
    except yaml.YAMLError as error:
        raise MechanismError(str(path), f"is not valid YAML: {_one_line(error)}") from None
    # A value that does not fit its tag makes PyYAML raise any exception.
    except Exception as error:
        problem = f"is not valid YAML ({type(error).__name__}: {error}); fix that value."
        raise MechanismError(str(path), problem) from None


def mechanism_of(mapping: Any, path: Path) -> Mechanism:
    """Return the mechanism that the data of the YAML file at a path describe."""

    def read(keys: CheckedMapping, points: dict[str, Point]) -> Body:
        file = keys["file"]
        try:
            reader = _FILES[file.choice("kind", _FILES)]
            return reader(keys, points, path.parent / file.text("path"))
        except ComponentFileError as error:
            raise MechanismError(f"{keys.path}.file", str(error)) from None

    try:
        mechanism = mechanism_from_mapping(mapping, read)
        return replace(mechanism, described=partial(with_values, mapping, mechanism))
    except MechanismError as error:
        raise MechanismError(f"{path}: {error.path}", error.problem) from None
    except ArithmeticError:
        problem = "has a number that is too large or too small to compute with; check the units."
        raise MechanismError(str(path), problem) from None


def _matrices(keys: CheckedMapping, points: dict[str, Point], path: Path) -> Body:
    return read_matrices(path)


def _frfs(keys: CheckedMapping, points: dict[str, Point], path: Path) -> Body:
    file = keys["file"]
    nodes = {file["nodes"].integer(point): point for point in file.names("nodes")}
    mass = keys.number("mass", positive=True) if "mass" in keys else None
    return read_frfs(path, nodes=nodes, points=points, mass=mass)


_FILES = {"matrices": _matrices, "frfs": _frfs}
"""What reads the body of a link from a file, by the ``kind`` of the file."""


def _one_line(error: yaml.YAMLError) -> str:
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        hint = "; write spaces instead of tabs" if repr("\t") in str(error.problem) else ""
        return f"line {error.problem_mark.line + 1}: {error.problem}{hint}."
    return " ".join(str(error).split())
