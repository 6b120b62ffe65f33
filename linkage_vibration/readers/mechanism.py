# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads mechanisms from YAML files."""

import itertools
from collections.abc import Hashable
from contextlib import suppress
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
from linkage_vibration.support.yaml_size import refuse_unbounded

_SHALLOW = 2000  # beginnings of collections; the loader in C ends the process at some depth


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
        if sum(map(text.count, "[{-?")) < _SHALLOW:
            with suppress(yaml.YAMLError):
                return yaml.load(text, _QuickLoader), text
        return yaml.load(text, _StrictLoader), text  # whose errors say more
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


def _whole_number(loader: Any, node: Any) -> int:
    """Return a whole number that a float can hold."""
    value = loader.construct_yaml_int(node)
    try:
        float(value)
    except OverflowError:
        raise yaml.constructor.ConstructorError(
            None, None, "the number is too large", node.start_mark
        ) from None
    return int(value)


class _Strict(yaml.constructor.SafeConstructor):
    """Loads plain data of bounded size; a repeated key, which YAML drops silently, is an error."""

    yaml_constructors = yaml.constructor.SafeConstructor.yaml_constructors | {
        "tag:yaml.org,2002:int": _whole_number
    }

    def construct_document(self, node: Any) -> Any:
        refuse_unbounded(node)
        return super().construct_document(node)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = key_node.value
            if isinstance(key, str) and key_node.tag != "tag:yaml.org,2002:merge":
                if key in seen:
                    raise yaml.constructor.ConstructorError(
                        None, None, f"the key {key!r} occurs twice; remove one", key_node.start_mark
                    )
                seen.add(key)
        for (_, before), (key, value) in itertools.pairwise(node.value):
            tags = before.tag.rpartition(":")[2], value.tag.rpartition(":")[2]
            if tags == ("int", "null") and str(key.value).isdecimal():
                number = f"{before.value}.{key.value}"
                hint = f"a comma ends a number; write {number} with a decimal point"
                raise yaml.constructor.ConstructorError(None, None, hint, key.start_mark)
        return super().construct_mapping(node, deep)


class _QuickLoader(_Strict, getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """The loader in C, which takes a tenth of the time."""


class _StrictLoader(_Strict, yaml.SafeLoader):
    """The loader in Python."""


def _one_line(error: yaml.YAMLError) -> str:
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        return f"line {error.problem_mark.line + 1}: {error.problem}."
    return " ".join(str(error).split())
