# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads what the lateral half of a linkage needs, and refuses what is not symmetric."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from linkage_vibration.mechanics.bodies.beam import Beam
from linkage_vibration.mechanics.description import (
    GROUND,
    Axle,
    Chain,
    Lateral,
    Link,
    Mechanism,
    MechanismError,
    Mount,
    Response,
    RigidBody,
)
from linkage_vibration.mechanics.keys import DAMPEST, RIGID, STIFFEST, CheckedMapping

_WIDEST = 20.0  # m; no linkage is wider, but numbers in millimetres are
_METRES = "write m, so divide millimetres by 1000"
_STRAIGHT = 1e-6  # m; points of a link are on one line if they are nearer to it


def with_lateral(
    mechanism: Mechanism, keys: CheckedMapping, response: Response, *, drawn: bool
) -> Mechanism:
    """Return a mechanism with the lateral half that keys describe, and its links in true length."""
    for link in mechanism.links:
        _check_link(link)
    y = _places(keys, mechanism)
    across = {name: _section(keys["sections"][name]) for name in keys.names("sections")}
    links = tuple(_in_space(link, y, across.get(link.name), keys) for link in mechanism.links)
    held = keys.words("held") if "held" in keys else ()
    for name in set(held).difference(body.name for body in mechanism.rigid_bodies):
        raise keys.error("held", f"{name!r} is not one of rigid_bodies; correct the name.")
    moving = [body for body in mechanism.rigid if body.name not in held]
    mounts = () if mechanism.base is None else mechanism.base.mounts
    axles = tuple(_axle(keys["axles"][mount.name], mount, drawn) for mount in mounts)
    if mechanism.base is not None:  # An axle may give the track of a mount that has none.
        mounts = tuple(
            replace(mount, track=mount.track or axle.track)
            for mount, axle in zip(mounts, axles, strict=True)
        )
        mechanism = replace(mechanism, base=replace(mechanism.base, mounts=mounts))
    lateral = Lateral(
        y=tuple(y.items()),
        inertia=tuple((body.name, _inertia(keys["inertia"], body, drawn)) for body in moving),
        roll_axes=tuple(_roll_axes(keys, moving, 360.0 if drawn else 180.0)),
        chains=tuple(_chain(keys["chains"][n], n, mechanism) for n in keys.names("chains")),
        axles=axles,
        rockshaft=_rockshaft(keys),
        held=held,
        sections=tuple((name, *each.values()) for name, each in across.items()),
        response=response,
        weight=keys.choice("weight", ["carried", "ignored"], default="carried") == "carried",
    )
    return replace(mechanism, links=links, lateral=lateral)


def _check_link(link: Link) -> None:
    """Refuse a link that the lateral half cannot have."""
    where = f"links.{link.name}"
    if not isinstance(link.body, Beam):
        problem = "it is from a file, which the lateral half cannot use"
        raise MechanismError(where, f"{problem}; give material and section, or remove `lateral`.")
    if link.count > 1 and link.count % 2:
        problem = f"{link.count} links are not symmetric, which `lateral` needs"
        raise MechanismError(f"{where}.count", f"{problem}; give 1 in the middle, or a pair.")
    for point, (_, z) in link.points:
        if z != 0.0:
            problem = "beside the axis of the link it twists the link, which `lateral` has not"
            raise MechanismError(f"{where}.points.{point}", f"{problem}; put it on the axis.")


def _places(keys: CheckedMapping, mechanism: Mechanism) -> dict[str, float]:
    """Read the y of points, m; on a link between two given ones, the others are on their line."""
    mounts = () if mechanism.base is None else mechanism.base.mounts
    names = keys.names("y")
    for point in names:
        if point in {mount.name for mount in mounts}:
            raise keys["y"].error(point, "this is a mount; give its track under `axles`.")
        if not mechanism.owners(point):
            raise keys["y"].error(point, "there is no such point; correct the name.")
    given = {
        point: keys["y"].number(point, least=0.0, most=_WIDEST, hint=f"give the left; {_METRES}")
        for point in names
    }
    y = dict(given)
    for link in mechanism.links:
        places = {point: x for point, (x, _) in link.points}
        known = [point for point in places if point in given]
        if len(known) > 1:
            first, last = known[0], known[-1]
            slope = (given[last] - given[first]) / (places[last] - places[first])
            for point in places.keys() - given.keys():
                y[point] = given[first] + slope * (places[point] - places[first])
    return y


def _in_space(
    link: Link, y: dict[str, float], across: dict[str, float] | None, keys: CheckedMapping
) -> Link:
    """Return a link in true length, and with a section across the plane."""
    places = {point: (x, y.get(point, 0.0)) for point, (x, _) in link.points}
    off = [point for point in places if places[point][1]]
    if link.count == 1 and off:
        problem = f"links.{link.name} is one link in the middle, so this has to be 0"
        raise keys.error(f"y.{off[0]}", f"{problem}; give the link `count: 2`, or remove it.")
    (x, first), *_, (end, last) = places.values()
    slope = (last - first) / (end - x)
    for point, (at, aside) in places.items():
        if abs(first + slope * (at - x) - aside) > _STRAIGHT:
            all_y = ", ".join(f"{name} {place[1]:g}" for name, place in places.items())
            problem = f"the points of links.{link.name} are not on one line ({all_y} m)"
            raise keys.error(f"y.{point}", f"{problem}; give two of them, or correct one.")
    assert isinstance(link.body, Beam)
    segments = tuple(
        replace(each, section=replace(each.section, **(across or {})))
        for each in link.body.segments
    )
    if any(math.isnan(each.section.second_moment_across) for each in segments):
        problem = "its shape is general, so give second_moment across the plane"
        raise keys.error(f"sections.{link.name}", f"{problem}.")
    return replace(link, slope=slope, body=replace(link.body, segments=segments))


def _section(keys: CheckedMapping) -> dict[str, float]:
    shear = keys.number("shear_coefficient", positive=True, default=5 / 6)
    second_moment = keys.number("second_moment", positive=True)
    return {"second_moment_across": second_moment, "shear_coefficient_across": shear}


def _inertia(keys: CheckedMapping, body: RigidBody, drawn: bool) -> tuple[float, float]:
    """Read the inertias of a body in roll and yaw, kg m2, which some body has if not drawn."""
    name = "base" if body.name == GROUND else body.name
    roll, yaw = (keys[name].number(axis, positive=True) for axis in ("roll", "yaw"))
    if not drawn and min(inertia_rooms(roll, body.inertia, yaw)) < 0.0:
        problem = f"{roll:g}, {body.inertia:g} and {yaw:g} kg m2 in roll, pitch and yaw are those "
        problem += "of no body, as one exceeds the sum of the others; correct them."
        raise keys[name].error("yaw" if yaw > roll else "roll", problem)
    return roll, yaw


def _roll_axes(
    keys: CheckedMapping, bodies: Sequence[RigidBody], most: float
) -> Iterator[tuple[str, float]]:
    """Yield the directions of roll that are given, rad, of bodies other than the base."""
    for body in (each for each in bodies if each.name != GROUND):
        own, hint = keys["inertia"][body.name], "give deg from the body's x axis towards its z axis"
        if "axis" in own:
            yield body.name, math.radians(own.number("axis", least=-most, most=most, hint=hint))


def inertia_rooms(*inertias: float) -> list[float]:
    """Return the logarithms of the sums of the other two of three inertias over each."""
    return [math.log((sum(inertias) - each) / each) for each in inertias]


def _chain(keys: CheckedMapping, name: str, mechanism: Mechanism) -> Chain:
    links = {link.name: link for link in mechanism.links}
    link = links[keys.choice("link", links)]
    if link.count == 1:
        problem = f"{link.name} is one link in the middle, and one chain is not symmetric"
        raise keys.error("link", f"{problem}; give a link of which there is a pair.")
    if mechanism.owners(name):
        raise keys.error("link", f"a point has the name {name} already; give the chain another.")
    begin, end = (link.points[i][1][0] for i in (0, -1))
    at = keys.number("at", least=begin, most=end, hint="give a place along the link")
    places = keys.numbers("end")
    if len(places) != 3 or max(map(abs, places)) > _WIDEST or places[1] < 0.0:
        raise keys.error("end", f"{places} is not [x, y, z] of the left one; {_METRES}.")
    x, y, z = places
    stiffness = keys.number("stiffness", positive=True, most=STIFFEST, hint=RIGID)
    damping = keys.number("damping", default=0.0, least=0.0, most=DAMPEST, hint=RIGID)
    given = "pretension" in keys
    tight = keys.number("pretension", positive=True, most=1e6, hint="give N") if given else None
    return Chain(name, link.name, at, (x, y, z), stiffness, damping, tight)


def _axle(keys: CheckedMapping, mount: Mount, drawn: bool) -> Axle:
    track, hint = mount.track, f"0 is an axle that pivots; {_METRES}"
    own = keys.number("track", default=track, least=0.0, most=_WIDEST, hint=hint)
    if own not in (0.0, track) and track and not drawn:
        problem = f"{own:g} m is not the track of this mount, {track:g} m"
        raise keys.error("track", f"{problem}; give it once, under base.mounts, or 0 here.")
    top, below = (_WIDEST if drawn else mount.at[1]), "it is a height, not above that of the mount"
    return Axle(
        own,
        keys.number("stiffness", least=0.0, most=STIFFEST, hint=RIGID),
        keys.number("damping", default=0.0, least=0.0, most=DAMPEST, hint=RIGID),
        keys.number("contact", least=-_WIDEST, most=top, hint=f"{below}; {_METRES}"),
    )


def _rockshaft(keys: CheckedMapping) -> float:
    try:
        keys.choice("rockshaft", ["rigid"], default="rigid")
        return math.inf
    except MechanismError:
        return keys.number("rockshaft", least=0.0, most=STIFFEST, hint="write `rigid`")
