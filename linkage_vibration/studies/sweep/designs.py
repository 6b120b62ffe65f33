# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A grid of designs, read from a YAML file.

The file has ``mechanism`` (a path beside it), ``parameters`` (the path of each in the mechanism's
description, with its values), ``angles_deg`` and ``tolerance``. Every combination of values is a
design. ``config/sweeps/implement.yaml`` shows every key.
"""

import hashlib
import itertools
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism, MechanismError
from linkage_vibration.mechanics.keys import Keys
from linkage_vibration.mechanics.paths import refuse_shared, split_paths, with_numbers
from linkage_vibration.readers.mechanism import load_yaml, mechanism_of
from linkage_vibration.support.version import VERSION
from linkage_vibration.table.tabulation import TOLERANCE

FORMAT = "linkage_vibration sweep 1"


class SweepError(LinkageVibrationError):
    """A sweep cannot be read or carried out."""


@dataclass(frozen=True, slots=True, eq=False)
class Designs:
    """A grid of designs, and the angles at which their tables are evaluated.

    The values of each parameter are those of the description; the last parameter varies fastest.
    """

    mapping: dict[str, Any]  # the description that they share, as read
    source: Path  # the file that it was read from; files that it names lie beside it
    paths: tuple[str, ...]  # the parameters, as `split_paths` takes them
    values: tuple[tuple[float, ...], ...]  # of each parameter
    alpha3: FloatArray  # (n_angles,), rad
    tolerance: float  # of each table, relative

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of values of each parameter."""
        return tuple(len(values) for values in self.values)

    @property
    def size(self) -> int:
        """The number of designs."""
        return math.prod(self.shape)

    def point(self, index: int) -> tuple[float, ...]:
        """Return the parameters' values of a design."""
        places = np.unravel_index(index, self.shape)
        return tuple(values[i] for values, i in zip(self.values, places, strict=True))

    def name(self, index: int) -> str:
        """Return the parameters of a design with their values, as text."""
        pairs = zip(self.paths, self.point(index), strict=True)
        return ", ".join(f"{path} = {value:g}" for path, value in pairs)

    def mechanism(self, index: int) -> Mechanism:
        """Return a design; a `MechanismError` is raised if its values describe no mechanism."""
        pairs = zip(self.paths, self.point(index), strict=True)
        numbers = [(place, value) for path, value in pairs for place in split_paths(path)]
        return mechanism_of(with_numbers(self.mapping, numbers), self.source)

    def digest(self, *hashes: str) -> str:
        """Return a digest of what results depend on, beside the hashes of the designs' models."""
        version = VERSION
        content = [FORMAT, version, hashes, self.alpha3.tolist(), self.tolerance]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def read_designs(path: Path) -> Designs:
    """Read a sweep and the description that it starts from.

    A SweepError names the file, the key and the fix.
    """
    try:
        return _read(path)
    except MechanismError as error:
        where = "" if error.path == str(path) else f"{path}: "
        raise SweepError(f"{where}{error}") from None


def _read(path: Path) -> Designs:
    asked, _ = load_yaml(path)
    names = tuple(Keys("", asked)["parameters"])
    keys = Keys("", {key: asked[key] for key in asked if key != "parameters"})
    source = path.parent / keys.text("mechanism")
    mapping, _ = load_yaml(source)
    base = mechanism_of(mapping, source)
    values = tuple(_values(asked["parameters"][name], f"parameters.{name}") for name in names)
    alpha3 = np.array([math.radians(angle) for angle in _linspace(keys["angles_deg"])])
    tolerance = keys.number("tolerance", positive=True, default=TOLERANCE)
    keys.refuse_unknown()
    refuse_shared(mapping, names, "parameters")
    if "response.modes" in itertools.chain(*map(split_paths, names)):
        what = "all designs need the same number of modes; set it in the mechanism."
        raise MechanismError("parameters.response.modes", what)
    if not names:
        raise MechanismError("parameters", "is empty; name at least one.")
    if alpha3.min() < base.stroke[0] or alpha3.max() > base.stroke[1]:
        low, high = (math.degrees(angle) for angle in base.stroke)
        what = f"leaves the stroke of {base.name}; give angles from {low:g} to {high:g} deg."
        raise MechanismError("angles_deg", what)
    return Designs(mapping, source, names, values, alpha3, tolerance)


def _values(value: Any, path: str) -> tuple[float, ...]:
    """Read the values of a parameter: a list, or from, to and points."""
    if isinstance(value, Mapping):
        keys = Keys(path, value)
        numbers = _linspace(keys)
        keys.refuse_unknown()
    elif isinstance(value, list) and value:
        places = Keys(path, {str(i): number for i, number in enumerate(value)})
        for i in places:
            places.number(i)
        numbers = value  # whole numbers stay whole, because a count of links has to be
    else:
        raise MechanismError(
            path, f"{value!r} is not a list of values; give one, or {{from: , to: , points: }}."
        )
    if len(set(numbers)) < len(numbers):
        raise MechanismError(path, "a value is listed twice; list each once.")
    return tuple(numbers)


def _linspace(keys: Keys) -> list[float]:
    ends = keys.number("from"), keys.number("to")
    return [float(x) for x in np.linspace(*ends, keys.integer("points"))]
