# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What elastic links are made of, one kind of body in each file (see `description.Body`)."""

from collections.abc import Callable

from linkage_vibration.mechanics.bodies import beam
from linkage_vibration.mechanics.description import Body, Point
from linkage_vibration.mechanics.keys import CheckedMapping

BodyReader = Callable[[CheckedMapping, dict[str, Point]], Body]
"""Reads a body from the keys of its link and the link's points."""

BODIES: dict[str, BodyReader] = {"material": beam.read}
"""The key by which a link is known to be of a kind, and what reads that kind.

Bodies from files, whose key is ``file``, are listed in `readers.mechanism`.
"""
