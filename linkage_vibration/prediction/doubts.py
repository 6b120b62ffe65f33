# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers of a mechanism or of excitations that are valid, but probably mistakes.

Each doubt is a sentence, which names a plausible number. No doubt stops anything.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Base, Chain, Cylinder, Mechanism, RigidBody
from linkage_vibration.mechanics.forces import GRAVITY, tyre_place
from linkage_vibration.mechanics.kinematics import Configuration, Kinematics, kinematics_of
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.paths import split_paths
from linkage_vibration.mechanics.springs import length_and_rate, oil_pressure
from linkage_vibration.prediction.excitation import KMH, RPM, Excitation, Source
from linkage_vibration.prediction.ground import MAX_OFF_GROUND
from linkage_vibration.prediction.loads import BASE_DISPLACEMENT
from linkage_vibration.table.table import Table

if TYPE_CHECKING:
    from linkage_vibration.prediction.levels import LevelTable

_STEEL, _WIDEST = 7850.0, 6.0  # kg/m3 and m: no implement is a solid bar of steel of this width
_PUMP = 200e5  # Pa; the pumps of tractors reach about this pressure
_NO_LEVER = 1e-6  # m; a shorter lever of a cylinder is rounding
_LEANS = 0.15  # m/m: a lift rod that leans so much makes the heave 1.5 % too high
_BESIDE = 0.5  # A centre of gravity is beside two pins beyond this share of their distance.
# A uniform bar from a pin to as far beyond its centre of gravity has a radius of gyration of 0.58
# of the distance of both; half of that is doubted: shipped implements have 0.49 to 0.76.
_COMPACT = 1.0 / math.sqrt(12.0)
_LOOSE = 0.5  # m; a tape measure leaves 0.01 m, a centre of gravity by eye 0.1 m
_TURNED = 45.0  # deg; an axis of roll is better known, and about 0 in many bodies
_COORDINATES = {"ground", "points", "centre_of_gravity", "at"}  # keys whose numbers are in m
_FRONT = 0.35, 0.5  # of the weight of a tractor without implement are on its front axle
_STEERS = 0.2  # of its own weight is the least on the axle that steers: EU 2015/208
_WHEELS = 0.2, 1.2  # m; rolling radii, from the wheels of garden tractors to 900/65R46
_BELOW = 0.5  # m; so far below its axles, a tractor has no body: the soil is there
_RUNOUT = 0.05  # m; tyres are out of round by a few mm, lugs of 0.05 m do not sink in wholly
_SPEEDS = {  # from slow to fast, in the unit of each speed
    Source.ENGINE: (400.0, 4000.0),  # rpm; diesels idle from 600, small petrol engines reach 3600
    Source.PTO: (200.0, 1500.0),  # rpm; 540, 750 and 1000, and 1400 in front
    Source.GROUND: (0.2, 20.0),  # m/s; creeping, and the 65 km/h of the fastest tractors
}
_UNITS = {True: {"km/h": 1.0 / KMH}, False: {"rad/s": 0.5 / math.pi / RPM, "Hz": 1.0 / RPM}}
_UNLOADS = 1.0  # A ratio above 0.71 lifts a pin off its seat in each period, where models end.
_WORKING = 10.0 / KMH  # m/s; the roughest field is worked at about this speed
_ROUGH = "about 0.5 is plausible on a farm track at 30 km/h, so check the units of amplitudes"


def linkage_doubts(model: LinkageModel) -> Iterator[str]:
    """Yield a sentence for the pose and each number of a mechanism that is not plausible."""
    mount_loads = model.mount_loads if model.force_places else None
    yield from _doubts(model.mechanism, model.kinematics, mount_loads)


def tabulated_doubts(mechanism: Mechanism, table: Table) -> Iterator[str]:
    """Return what `linkage_doubts` yields, by the forces at rest that a table has already."""
    mounts = () if mechanism.base is None else mechanism.base.mounts
    if mounts and not table.forces:  # A table of a tractor that rolls freely has none.
        return linkage_doubts(LinkageModel(mechanism))
    tyres = [table.forces.index(tyre_place(mount.name)) for mount in mounts]

    def mount_loads(alpha3: float) -> FloatArray:
        return -table.components_at_rest(np.array([alpha3]))[tyres, 0]

    return _doubts(mechanism, kinematics_of(mechanism), mount_loads)


def _doubts(
    mechanism: Mechanism, kinematics: Kinematics, mount_loads: Callable[[float], FloatArray] | None
) -> Iterator[str]:
    """Yield the doubts; loads of the mounts, N, are known at an angle, rad, or not at all."""
    stroke = np.linspace(*mechanism.stroke, 9).tolist()
    if kinematics.notice:
        yield kinematics.notice
    for body in mechanism.rigid:
        yield from _compact(body)
    for body in mechanism.rigid_bodies:
        yield from _overlap(mechanism, body, kinematics.at(mechanism.assembly_alpha3))
    yield from _overload(mechanism, [kinematics.at(angle) for angle in stroke])
    yield from _leaning(mechanism)
    for one, other in combinations(mechanism.links, 2):
        pins = dict(one.points).keys() & dict(other.points).keys()
        if pins and {one.count, other.count} == {1, 2}:
            single, pair = sorted((one, other), key=lambda link: link.count)
            text = f"count: 2, but {single.name}, which shares {min(pins)} with it, is single"
            yield f"{pair.name} has {text}; write `count: 2` if there is one on either side."
    off = {point for point, y in mechanism.lateral.y if y} if mechanism.lateral else set[str]()
    for link in mechanism.links:
        if off and link.count > 1 and off.isdisjoint(dict(link.points)):
            yield f"Both of {link.name} are in the middle; give the y of its points in `lateral`."
    yield from _uncertain(mechanism)
    if mechanism.base is not None and mechanism.base.mounts:
        yield from _on_soil(mechanism, min(mount.at[1] for mount in mechanism.base.mounts))
    if mechanism.base is not None and mechanism.base.mounts and mount_loads:
        loads = np.array([mount_loads(angle) for angle in stroke])
        yield from _tips(mechanism.base, loads, stroke)


def _on_soil(mechanism: Mechanism, axles: float) -> Iterator[str]:
    """Yield a sentence for each spring to a point of the base far below its axles, z in m."""
    low = {point for point, (_, z) in mechanism.ground if z < axles - _BELOW}
    for spring in mechanism.springs:
        for point in filter(low.__contains__, spring.points):
            yield (
                f"Spring {spring.name} ends at {point}, more than {_BELOW:g} m below the axles. It "
                "is a point of the tractor, not of the soil: a wheel that carries the implement "
                "cannot be described beside `base`."
            )


def excitation_doubts(excitations: Sequence[Excitation], levels: "LevelTable") -> Iterator[str]:
    """Yield a sentence for each number of excitations that is not plausible.

    The last ones are about load ratios, those of each order at the speed of its amplitude, and
    about tyres that leave the ground and chains that go slack at 10 km/h.
    """
    own = [_odd(excitation) for excitation in excitations]
    yield from dict.fromkeys(filter(None, own))
    if levels.lacks_track:
        [name] = [each.name for each in excitations if each.terrain]
        text = (
            "has no track, so both wheels of an axle follow the same heights, and levels are up to"
        )
        yield f"{name} {text} 1.4 times too high; give each axle of the base its `track`, in m."
    for low, high in np.degrees(levels.gaps).tolist():
        text = "where they change too fast to be tabulated, as they do if two modes coincide"
        hint = "leave these angles out of input.range_deg if the crank does not need them"
        yield f"Levels are not known at alpha3 = {low:.6g} to {high:.6g} deg, {text}; {hint}."
    loads = [bool(each.load or each.terrain) for each in excitations]
    yield from _slack_chains(levels)
    rows = [i for i, loaded in enumerate(loads) if loaded and not own[i]]
    if not rows or not levels.has_load_ratios:
        return
    speeds = np.full((len(Source), len(rows)), math.nan)
    for column, i in enumerate(rows):
        load, source = excitations[i].load, excitations[i].source
        speeds[source.index, column] = load.speed if load else _WORKING
    angles = np.linspace(*levels.alpha3_range, 9)
    over_all = levels.at_all_pairs(angles, speeds)
    ratios = over_all.load_ratios.reshape(len(angles), len(rows), -1)
    off = over_all.off_ground_share.reshape(len(angles), len(rows))
    for column, i in enumerate(rows):
        excitation, over = excitations[i], np.nan_to_num(ratios[:, column, i])
        if excitation.terrain and (share := np.nan_to_num(off[:, column]).max()) > MAX_OFF_GROUND:
            text = f"A tyre is off the ground for {share:.2g} of the time at 10 km/h on"
            yield f"{text} {excitation.name}; 0 to 0.1 is plausible, so check terrain and tyres."
        if excitation.load and over.max() > _UNLOADS:
            at = math.degrees(angles[over.argmax()])
            where = f"of {excitation.name} at alpha3 = {at:.0f} deg and its at_speed"
            small = f"an amplitude of {excitation.load.amplitude / over.max():.2g} would have 1"
            yield load_ratio_doubt(over.max(), where, f"{small}, so check its unit")


def _slack_chains(levels: "LevelTable") -> Iterator[str]:
    """Yield a sentence for each chain that three times its force by the ground makes slack.

    One of unknown pretension is named with what it needs, and one whose force is not known, too.
    """
    angles = np.linspace(*levels.alpha3_range, 9)
    every = levels.chain_forces(angles, _WORKING)
    every = every if len(every) else np.full((len(levels.chains), len(angles)), math.nan)
    for chain, rms in zip(levels.chains, every, strict=True):
        if np.isnan(rms).all():
            why = "its force by the ground is not"
            yield f"Whether {chain.name} goes slack is not known, as {why}."
            continue
        needed = 3.0 * np.fmax.reduce(rms, initial=0.0)
        alpha3 = angles[np.argmax(np.nan_to_num(rms))]
        ground = f"three times the rms of its force by the ground at 10 km/h, {needed:.3g} N at "
        ground += f"alpha3 = {math.degrees(alpha3):.0f} deg"
        if chain.pretension is None:
            unknown = "has no `pretension`, so it is not known whether it goes slack"
            yield f"{chain.name} {unknown}; it needs {ground}."
        elif needed > chain.pretension:
            tight, slack = slack_mode(levels.mechanism, chain, alpha3)
            assert levels.lateral is not None
            own = levels.lateral.evaluate(np.array([alpha3]))[0, : levels.lateral.n_modes]
            name = levels.lateral.mode_names[int(np.abs(own - tight).argmin())]
            yield (
                f"{chain.name} goes slack, as {ground}, exceeds its pretension of "
                f"{chain.pretension:g} N; with one of both slack, the {name} is at about "
                f"{slack:.3g} instead of {tight:.3g} Hz there. Tighten it, or drive more slowly."
            )


def slack_mode(mechanism: Mechanism, chain: Chain, alpha3: float) -> tuple[float, float]:
    """Return the undamped frequency of the mode that one slack chain lowers most, and then, Hz.

    One chain holds the lateral half with half of the stiffness; that it couples both halves is
    neglected.
    """
    assert mechanism.lateral is not None
    loose = replace(chain, stiffness=chain.stiffness / 2.0)
    chains = tuple(loose if each.name == chain.name else each for each in mechanism.lateral.chains)
    other = replace(mechanism, lateral=replace(mechanism.lateral, chains=chains))
    n = mechanism.lateral.response.modes
    tight, slack = (LinkageModel(x, half="lateral").solve(alpha3) for x in (mechanism, other))
    own, lower = (each.modes.omega[:n] / math.tau for each in (tight, slack))
    mode = int((lower / own).argmin())
    return float(own[mode]), float(lower[mode])


def load_ratio_doubt(ratio: float, where: str, hint: str = _ROUGH) -> str:
    """Return that a load ratio is too high to be true; empty if it is not."""
    text = "is above 1: pins would leave their seats, and play would limit it"
    return f"The load ratio {where}, {ratio:.3g}, {text}; {hint}." if ratio > _UNLOADS else ""


def _odd(excitation: Excitation) -> str:
    """Return what is not plausible about the wheel, the speed or the runout; empty if nothing."""
    name, load, source = excitation.name, excitation.load, excitation.source
    entry = name if excitation.terrain else name.rpartition(" ")[0]
    radius, (least, most) = excitation.rolling_radius, _WHEELS
    if not math.isnan(radius) and not least <= radius <= most:
        hint = f"; write {radius / 2.0:g} if it is a diameter" if radius > most else ""
        has = f"a rolling_radius of {radius:g} m, and wheels have {least:g} to {most:g} m"
        return f"{entry} has {has}{hint}."
    if load is None:
        return ""
    slow, fast = _SPEEDS[source]
    if not slow <= load.speed <= fast:
        meant = {unit: load.speed * by for unit, by in _UNITS[source is Source.GROUND].items()}
        fits = [f"{v:.4g} if it is in {u}" for u, v in meant.items() if slow <= v <= fast]
        has = f"an at_speed of {load.speed:g} {source.unit}, and {source.label} speeds are"
        hint = f"; write {' or '.join(fits)}" if fits else ""
        return f"{entry} has {has} {slow:g} to {fast:g} {source.unit}{hint}."
    if load.kind == BASE_DISPLACEMENT and load.amplitude > _RUNOUT:
        has = f"a base_displacement of {load.amplitude:g} m, and tyres run out by millimetres"
        return f"{name} has {has}; write {load.amplitude / 1e3:g} if it is in mm."
    return ""


def _compact(body: RigidBody) -> Iterator[str]:
    """Yield a sentence if the inertia of a rigid body is too small for its mass and its pins."""
    radius = math.sqrt(body.inertia / body.mass)
    away = min((math.dist(body.centre_of_gravity, p) for _, p in body.points), default=0.0)
    bar = math.sqrt(body.mass / (2.0 * math.pi * _STEEL * _WIDEST))  # of steel, seen from its end
    if radius < max(bar, _COMPACT * away):
        usual = max(bar, 2.0 * _COMPACT * away)
        has = f"a radius of gyration of {radius:.2g} m; with its mass and pins, {usual:.2g} m"
        inertia = f"an inertia of {body.mass * usual**2:.3g} kg m2 about its centre of gravity"
        yield f"{body.name} has {has} is plausible, {inertia}."


def _uncertain(mechanism: Mechanism) -> Iterator[str]:
    """Yield a sentence for each standard deviation that nobody measures so badly."""
    for number in mechanism.uncertainty.numbers if mechanism.uncertainty else ():
        place = not _COORDINATES.isdisjoint(split_paths(number.path)[0].split("."))
        most = _LOOSE if place else max(abs(number.value), _TURNED * number.path.endswith(".axis"))
        if number.deviation > most:
            usual = "0.01 with a tape measure, 0.1 by eye" if place else f"at most {most:g}"
            has = f"{number.deviation:g}, and {usual} is plausible"
            yield f"The standard deviation of {number.path} is {has}; check its unit."


def _tips(base: Base, loads: FloatArray, stroke: Sequence[float]) -> Iterator[str]:
    """Yield a sentence if a tractor tips alone, or under loads of its mounts, (n, n_mounts), N."""
    rear, front = (end(base.mounts, key=lambda each: each.at[0]) for end in (min, max))
    centre, (behind, ahead) = base.body.centre_of_gravity[0], (rear.at[0], front.at[0])
    low, high = (behind + share * (ahead - behind) for share in _FRONT)
    if behind < ahead and not behind < centre < ahead:
        place = f"at x = {centre:g} m, not between {rear.name} and {front.name}, so it tips"
        plausible = f"{low:.2f} to {high:.2f} m is plausible"
        yield f"The centre of gravity of the base is {place}; {plausible}."
    elif (least := np.nan_to_num(loads).min()) < 0.0:
        row, column = np.argwhere(loads == least)[0]
        at = f"{base.mounts[column].name} at alpha3 = {math.degrees(stroke[row]):.0f} deg"
        own = _STEERS * base.body.mass
        hint = f"{own:.0f} kg or more are plausible, so check masses and places"
        yield f"The static load of {at} is {least / GRAVITY:.0f} kg, so the tractor tips; {hint}."


def _overload(mechanism: Mechanism, over: Sequence[Configuration]) -> Iterator[str]:
    """Yield a sentence if the weight of the rigid bodies needs a pressure that no tractor has.

    A cylinder that alone holds the crank has the tension T with T dL = -dV: virtual work.
    """
    springs = [spring for spring in mechanism.springs if spring.stiffness != 0.0]
    cylinder = springs[0].stiffness if len(springs) == 1 else None
    if not isinstance(cylinder, Cylinder) or any(link.clamped for link in mechanism.links):
        return
    loads = []
    for at in over:
        _, lever = length_and_rate(springs[0], mechanism, at)
        if abs(lever) < _NO_LEVER:
            angle = math.degrees(at.alpha3)
            text = f"has no lever at alpha3 = {angle:.0f} deg, so it holds nothing there"
            yield f"{springs[0].name} {text}; check where its ends are."
            return
        bodies = mechanism.rigid_bodies
        rates = [body.mass * at.place_rate(body.name, body.centre_of_gravity)[1] for body in bodies]
        tension = -GRAVITY * sum(rates) / (cylinder.count * lever)
        loads.append((oil_pressure(cylinder, tension), lever, math.degrees(at.alpha3)))
    if any(math.isnan(pressure) for pressure, *_ in loads):
        text = "would have to pull, but no oil is locked on the side of its rod"
        yield f"{springs[0].name} {text}; check base_end and rod_end, or give `rod`."
        return
    pressure, lever, angle = max(loads)
    if pressure > _PUMP:
        need = f"needs {pressure / 1e5:.0f} bar in {springs[0].name} at alpha3 = {angle:.0f} deg"
        has = f"its lever is {1e3 * abs(lever):.0f} mm, and tractors reach {_PUMP / 1e5:.0f} bar"
        yield f"The implement's weight {need}, where {has}; check base_end, rod_end and bore."


def _leaning(mechanism: Mechanism) -> Iterator[str]:
    """Yield links between other links that pull them across the plane, where they bend freely."""
    links = {link.name for link in mechanism.links}
    for link in mechanism.links:
        ends = [mechanism.owners(link.points[end][0]) for end in (0, -1)]
        if abs(link.slope) > _LEANS and all(links.issuperset(of) for of in ends):
            angle = math.degrees(math.atan(abs(link.slope)))
            text = f"{link.name} leans sideways by {angle:.0f} deg, and links do not bend across"
            yield f"{text} the plane in the vertical half, so modes may be some percent too high."


def _overlap(mechanism: Mechanism, body: RigidBody, at: Configuration) -> Iterator[str]:
    """Yield a sentence if a body that links carry by upright pins lies on the ground's side."""
    pins = [place for point, place in body.points if len(mechanism.owners(point)) > 1]
    if len(pins) != 2:
        return
    places = [at.place(body.name, place) for place in (*pins, body.centre_of_gravity)]
    places.append(np.mean([place for _, place in mechanism.ground], axis=0))
    along, size = places[1] - places[0], math.dist(*pins)
    across = np.array([-along[1], along[0]]) / size
    centre, carrier = (float(across @ (place - places[0])) for place in places[2:])
    upright = abs(along[1]) > abs(along[0])
    if upright and centre * carrier > 0.0 and abs(centre) > _BESIDE * size:
        problem = f"is {abs(centre):.2g} m from the line of its pins towards the ground"
        hint = "where its carrier is; check `side`, or the signs of its coordinates"
        yield f"The centre of gravity of {body.name} {problem}, {hint}."
