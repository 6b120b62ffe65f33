# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Files of parameters in YAML, as ROS 2 reads them from ``--params-file``."""

import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import yaml

from linkage_vibration.prediction.settings import (
    NODE_NAME,
    ParameterError,
    Parameters,
    is_ros_parameter,
    with_values,
)
from linkage_vibration.support.atomic_files import read_text
from linkage_vibration.support.version import VERSION


def parameters_yaml(parameters: Parameters, node_name: str) -> str:
    """Return a YAML file that gives these parameters to a node, named with its namespace."""
    values = {f.name: getattr(parameters, f.name) for f in fields(parameters)}
    plain = {name: list(v) if isinstance(v, tuple) else v for name, v in values.items()}
    sections = {node_name: {"ros__parameters": plain}}
    return f"# linkage_vibration {VERSION}\n" + yaml.safe_dump(
        sections, sort_keys=False, default_flow_style=None
    )


class _Loader(yaml.SafeLoader):
    """YAML as ROS 2 reads it, where 1e-3 is a number."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)


def read_parameters(path: str | Path) -> Parameters:
    """Read a file of parameters, as a node reads it from ``--params-file``.

    If several sections match the node, later ones override earlier ones.

    Raises
    ------
    ParameterError
        If the file cannot be read, has no section for the node, or has an unknown parameter or an
        invalid value.
    """
    path = Path(path)
    sections = [section for name, section in _sections(path) if _matches(name, f"/{NODE_NAME}")]
    if not sections:
        raise ParameterError(missing_section(path, NODE_NAME))
    values: dict[str, object] = {}
    for section in sections:
        given = section.items() if isinstance(section, dict) else ()
        values |= {str(name): value for name, value in given if not is_ros_parameter(str(name))}
    try:
        return with_values(Parameters(), values)
    except (ParameterError, OverflowError) as error:
        raise ParameterError(f"{path}: {error}") from None


def has_parameters(path: Path, node_name: str) -> bool:
    """Return whether a file of parameters has a section for a node, named with its namespace."""
    return any(_matches(name, node_name) for name, _ in _sections(path))


def missing_section(path: Path, node_name: str) -> str:
    """Return the sentence that a file of parameters has no section for a node."""
    return (
        f"{path} has no parameters for the node; give them below `{node_name}:` or `/**:` and "
        "there `ros__parameters:`."
    )


def _sections(path: Path) -> list[tuple[str, object]]:
    """Return the names of the nodes in a file, which may have wildcards, and their parameters."""
    try:
        content = yaml.load(read_text(path), _Loader)
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        problem = " ".join(str(error).split())
        raise ParameterError(f"{path} cannot be read as YAML: {problem}.") from None
    return list(_named(content, ""))


def _named(content: object, namespace: str) -> Iterator[tuple[str, object]]:
    """Yield the names and the parameters of the nodes in a namespace, also in nested ones."""
    for key, section in content.items() if isinstance(content, dict) else ():
        name = f"{namespace}/{str(key).strip('/')}"
        if isinstance(section, dict) and "ros__parameters" in section:
            yield name, section["ros__parameters"]
        else:
            yield from _named(section, name)


def _matches(section: str, node_name: str) -> bool:
    """Return whether the name of a section, which may have wildcards, is that of a node."""
    pattern = re.escape(section).replace(r"/\*\*", r"(/\w+)*").replace(r"/\*", r"/\w+")
    return re.fullmatch(pattern, node_name) is not None
