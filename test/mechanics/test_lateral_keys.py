# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The key `lateral`: what is read, what leaves other mechanisms as they are, what is refused."""

import copy
import math
from collections.abc import Callable
from typing import Any

import pytest
import yaml

from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import (
    DEFAULT_MECHANISM,
    PAPER_MECHANISM,
    PAPER_TABLE,
    config_file,
)
from linkage_vibration.table.table import load_table
from test.mechanics.test_parsing import change, remove


@pytest.fixture
def mapping() -> Any:
    """Return the shipped hitch with its lateral half, exact, as a mapping that a test may spoil."""
    mapping = yaml.safe_load(config_file(DEFAULT_MECHANISM).read_text())
    del mapping["uncertainty"]
    return mapping


def test_points_of_a_link_lie_on_a_line(mapping: Any) -> None:
    """V1 has the y that the lower link has there, and links are as much longer as they are wide."""
    mechanism = mechanism_from_mapping(mapping)
    assert mechanism.lateral is not None
    y = dict(mechanism.lateral.y)
    assert y["V1"] == pytest.approx(0.2 + 0.2 * 0.366 / 0.810, rel=1e-14)
    assert y.get("E2", 0.0) == 0.0
    links = {link.name: link for link in mechanism.links}
    true = math.hypot(0.810, 0.4 - 0.2) / 0.810
    assert links["lower_link"].stretch == pytest.approx(true, rel=1e-14)
    assert links["upper_link"].stretch == links["input_crank"].stretch == 1.0


def test_without_lateral_nothing_changes(mapping: Any) -> None:
    """The hash of the paper's linkage is that of its table; numbers under lateral enter a hash."""
    paper = read_mechanism(config_file(PAPER_MECHANISM))
    assert load_table(config_file(PAPER_TABLE)).model_hash == paper.model_hash
    known = mechanism_from_mapping(mapping).model_hash
    for path in (
        ("chains", "check_chain", "damping"),
        ("inertia", "base", "yaw"),
        ("axles", "front_axle", "damping"),
        ("y", "V1"),
    ):
        spoiled = copy.deepcopy(mapping)
        change("lateral", *path, to=0.2 + 0.2 * 0.366 / 0.810 - 5e-7 * (path[0] == "y"))(spoiled)
        if path[0] == "inertia":
            change("lateral", *path, to=6001.0)(spoiled)
        assert mechanism_from_mapping(spoiled).model_hash != known


def test_a_general_section_needs_its_other_second_moment(mapping: Any) -> None:
    """It enters the hash, and is missed where dimensions do not give it."""
    link = mapping["links"]["upper_link"]
    link["section"] = {"shape": "general", "area": 4e-3, "second_moment": 2e-6}
    with pytest.raises(
        MechanismError, match=r"lateral\.sections\.upper_link: its shape is general"
    ):
        mechanism_from_mapping(mapping)
    hashes = set()
    for second_moment in (1e-6, 2e-6):
        mapping["lateral"]["sections"] = {"upper_link": {"second_moment": second_moment}}
        mechanism = mechanism_from_mapping(mapping)
        hashes.add(mechanism.model_hash)
        body: Any = next(x.body for x in mechanism.links if x.name == "upper_link")
        assert body.segments[0].section.turned.second_moment == second_moment
        assert body.segments[0].section.turned.shear_coefficient == 5 / 6
    assert len(hashes) == 2


@pytest.mark.parametrize(
    ("spoil", "path", "words"),
    [
        (change("links", "lift_rod", "count", to=3), "links.lift_rod.count", "not symmetric"),
        (change("links", "lift_rod", "points", "V1", to=[0.534, 0.01]), "points.V1", "axis"),
        (change("lateral", "y", "V1", to=0.29037156), "lateral.y.V1", "not on one line"),  # 1.2 um
        (change("lateral", "y", "P2", to=0.10), "lateral.y.P2", "one link in the middle"),
        (change("lateral", "y", "Q", to=0.10), "lateral.y.Q", "no such point"),
        (change("lateral", "y", "rear_axle", to=0.1), "lateral.y.rear_axle", "track"),
        (change("lateral", "y", "E1", to=400.0), "lateral.y.E1", "divide millimetres"),
        (change("lateral", "y", "E1", to=-0.4), "lateral.y.E1", "give the left"),
        (remove("lateral", "inertia", "implement"), "lateral.inertia.implement", "missing"),
        (remove("lateral", "inertia", "base", "yaw"), "lateral.inertia.base.yaw", "missing"),
        (change("lateral", "inertia", "roll", to={}), "lateral.inertia.roll", "not known"),
        (
            change("lateral", "inertia", "implement", "roll", to=851.0),
            "implement.roll",
            "of no body",
        ),
        (change("lateral", "inertia", "implement", "yaw", to=751.0), "implement.yaw", "of no body"),
        (remove("lateral", "axles", "front_axle"), "lateral.axles.front_axle", "missing"),
        (change("lateral", "axles", "rear_axle", "track", to=-1.0), "rear_axle.track", "pivots"),
        (change("lateral", "axles", "rear_axle", "contact", to=-850), "contact", "height"),
        (change("lateral", "axles", "rear_axle", "contact", to=-0.04), "contact", "not above that"),
        (remove("lateral", "chains", "check_chain", "end"), "check_chain.end", "missing"),
        (change("lateral", "chains", "check_chain", "end", to=[0, 1]), "chain.end", "x, y, z"),
        (change("lateral", "chains", "check_chain", "end", to=[0, -0.1, 0]), "end", "the left one"),
        (change("lateral", "chains", "check_chain", "at", to=0.9), "check_chain.at", "along"),
        (change("lateral", "chains", "check_chain", "link", to="upper_link"), "link", "one chain"),
        (change("lateral", "chains", "check_chain", "stiffness", to=[5e6, 4e6]), "stiff", "number"),
        (change("lateral", "chains", "check_chain", "pretension", to=0.0), "pretension", "zero"),
        (change("lateral", "axles", "rear_axle", "track", to=1.7), "rear_axle.track", "1.6 m"),
        (change("lateral", "rockshaft", to="stiff"), "lateral.rockshaft", "text"),
        (change("lateral", "held", to=["plough"]), "lateral.held", "rigid_bodies"),
        (
            change("lateral", "inertia", "implement", "axis", to=181.0),
            "implement.axis",
            "above 180; give deg",
        ),
        (change("lateral", "held", to=["implement"]), "lateral.inertia.implement", "not known"),
        (change("lateral", "response", "direction", to="theta"), "response.direction", "x, y, z"),
        (change("lateral", "weight", to="left out"), "lateral.weight", "carried, ignored"),
        (change("lateral", "float", to={}), "lateral.float", "not known"),
        (change("response", "direction", to="y"), "response.direction", "x, z"),
    ],
)
def test_what_is_not_symmetric_is_refused(
    mapping: Any, spoil: Callable[[Any], None], path: str, words: str
) -> None:
    """The error names the key and the fix; a roll of 850 kg m2 beside 200 and 650 is possible.

    So is soil at the height of the mount, -0.05 m.
    """
    change("lateral", "axles", "rear_axle", "contact", to=-0.05)(mapping)
    change("lateral", "inertia", "implement", "roll", to=850.0)(mapping)
    mechanism_from_mapping(mapping)
    change("lateral", "inertia", "implement", "roll", to=550.0)(mapping)
    spoil(mapping)
    with pytest.raises(MechanismError, match=words) as raised:
        mechanism_from_mapping(mapping)
    assert path in raised.value.path


def test_links_from_files_are_refused(mapping: Any) -> None:
    """A body that is no beam has no lateral half here."""
    mapping["links"]["lift_rod"]["file"] = {}
    with pytest.raises(MechanismError, match=r"links\.lift_rod: it is from a file"):
        mechanism_from_mapping(mapping, lambda keys, _: keys["file"] and None)  # type: ignore
