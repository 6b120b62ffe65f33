# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The position of a joint in ``sensor_msgs/JointState``, with its velocity."""

from collections.abc import Sequence

from linkage_vibration.bags.field_reader import FieldReader
from linkage_vibration.bags.schemas import Schema, Step

_MAX_NAMES = 20


class JointReader(FieldReader):
    """Reads the position of a joint, found by its name in any order, and its velocity."""

    def __init__(self, schema: Schema, type_name: str, path: str, position: Step) -> None:
        super().__init__(schema, type_name, path, rates="velocity")
        self._joint = position.name

    def describe(self) -> str:
        """Return the name of the joint, in words."""
        return f"joint {self._joint}"

    def explain_missing(self, topic: str, names: Sequence[str]) -> str:
        """Return that the joint is missing, which joints are there, and the remedy."""
        if not names:
            return f"{topic} has no joint at all; check its publisher, or choose another topic."
        listing = ", ".join(sorted(names)[:_MAX_NAMES])
        return (
            f"{topic} has no joint {self._joint}; it has {listing}. Set joint_name "
            "(`--joint`) to one of them, or choose another topic."
        )
