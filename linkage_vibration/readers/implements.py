# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the file that names the implements of a hitch."""

from pathlib import Path

from linkage_vibration.mechanics.description import Mechanism, MechanismError
from linkage_vibration.mechanics.keys import CheckedMapping
from linkage_vibration.mechanics.parsing import read_rigid
from linkage_vibration.prediction.answers import Implement, ServingError, rigid_body_name
from linkage_vibration.readers.mechanism import load_yaml


def read_implements(path: str | Path, mechanism: Mechanism) -> dict[str, Implement]:
    """Read the implements that a rigid body of a mechanism can stand for, by their names."""
    path = Path(path)
    try:
        top = CheckedMapping("", load_yaml(path)[0])
        keys = top["implements"]
        implements = {name: _implement(keys[name], mechanism) for name in keys}
        for name in implements:
            if not name.strip() or name != name.strip():
                raise keys.error(name, f"{name!r} has spaces around it or no letters.")
        top.refuse_unknown()
    except MechanismError as error:
        where = error.path if str(path) in error.path else f"{path}: {error.path}"
        raise MechanismError(where, error.problem) from None
    if not implements:
        raise MechanismError(f"{path}: implements", "names no implement; add one.")
    return implements


def _implement(keys: CheckedMapping, mechanism: Mechanism) -> Implement:
    """Read an implement, with the checks of a rigid body."""
    asked = keys.text("rigid_body") if "rigid_body" in keys else ""
    try:
        name = rigid_body_name(mechanism, asked)
    except ServingError as error:
        raise keys.error("rigid_body", str(error)) from None
    body = next(body for body in mechanism.rigid_bodies if body.name == name)
    rigid = read_rigid(keys, name, dict(body.points))
    label = keys.path.partition(".")[2]
    return Implement(name, rigid.mass, rigid.inertia, rigid.centre_of_gravity, label)
