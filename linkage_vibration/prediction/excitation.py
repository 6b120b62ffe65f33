# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Excitations: frequencies and forces that follow the speed of engine, PTO or ground."""

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass

from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.mechanics.keys import CheckedMapping
from linkage_vibration.prediction.ground import Spectrum, Terrain, power_law
from linkage_vibration.prediction.loads import ExcitationError, Load, given_kinds

RPM = 1.0 / 60.0  # 1/min in Hz
KMH = 3.6  # 1 m/s in km/h

_LEAST, _LARGEST = 1e-6, 1e6  # of a number in a description
_STEEPEST = 4.0  # of exponents
_WHEELS = 0.01, 10.0  # m: rolling radii; numbers in millimetres are beyond
_CLASSES = {name: 16e-6 * 4.0**k for k, name in enumerate("ABCDEFGH")}  # ISO 8608, m3 at 0.1 1/m
_TIMES = {0.5: "every second turn", 1.0: "once a turn", 2.0: "twice a turn"}
_WITHIN_CLASS = 0.2  # of amplitudes: a class reaches from half to twice its mean roughness

ReadProfile = Callable[[str], tuple[Spectrum, Spectrum | None]]
"""Returns the spectra of a track, or of the mean and half the difference of two."""


class Source(enum.Enum):
    """A speed to which excitation frequencies are proportional."""

    ENGINE = "engine"  # rpm
    PTO = "pto"  # rpm
    GROUND = "ground"  # m/s
    __hash__ = object.__hash__  # The one of Enum takes several times as long.

    @property
    def index(self) -> int:
        """Index of the speed among those of all sources."""
        return list(Source).index(self)

    @property
    def label(self) -> str:
        """How sentences name the speed."""
        return "PTO" if self is Source.PTO else self.value

    @property
    def unit(self) -> str:
        """Unit of the speed."""
        return "m/s" if self is Source.GROUND else "rpm"

    @property
    def si(self) -> float:
        """The speed 1 in SI units, rad/s or m/s, in which messages have it."""
        return 1.0 if self is Source.GROUND else 2.0 * math.pi * RPM


@dataclass(frozen=True, slots=True)
class Excitation:
    """A frequency that follows a speed."""

    name: str  # such as "engine 1.5"
    source: Source
    ratio: float  # Hz/rpm or Hz/(m/s); NaN for a terrain
    load: Load | None = None  # None if the amplitude is not known
    relative_stddev: float = 0.0  # of the frequency
    warns: bool = True
    terrain: Terrain | None = None  # what wheels roll on, if that excites
    rolling_radius: float = math.nan  # m; NaN without a wheel
    description: str = ""  # what it is in words, such as "tines of the harrow, twice a turn"

    @property
    def is_order(self) -> bool:
        """Whether it has a frequency; the ground has none, also where its level is not used."""
        return not math.isnan(self.ratio)


def no_profile(name: str) -> tuple[Spectrum, None]:
    """Refuse a profile, which only a file of excitations can name."""
    raise ExcitationError(f"{name} is not read here; give the roughness of the terrain instead.")


def excitations_from_mapping(
    mapping: object, where: str = "excitations", read_profile: ReadProfile = no_profile
) -> tuple[Excitation, ...]:
    """Return the excitations that a mapping describes; docs/excitation.md describes its keys.

    ``where`` begins the errors, and ``read_profile`` returns the spectra of a profile in a file.
    An ExcitationError names a key that is missing, unknown or invalid.

    >>> excitations = excitations_from_mapping({"shaft": {"speed": "pto", "orders": [1, 2]}})
    >>> [(each.name, round(540 * each.ratio, 6)) for each in excitations]
    [('shaft 1', 9.0), ('shaft 2', 18.0)]
    """
    try:
        keys, excitations = CheckedMapping(where, mapping), list[Excitation]()
        for name in keys:
            if "terrain" in keys[name]:
                excitations.append(_ground(keys[name], name, read_profile))
            else:
                excitations += _orders(keys[name], name)
        keys.refuse_unknown()
        for second in [excitation.name for excitation in excitations if excitation.terrain][1:]:
            raise MechanismError(
                where, f"{second} is a second terrain, but all wheels roll on one; remove it."
            )
    except MechanismError as error:
        raise ExcitationError(str(error)) from None
    if not excitations:
        raise ExcitationError(f"{where}: there is no excitation; give at least one by its name.")
    return tuple(excitations)


def _orders(keys: CheckedMapping, name: str) -> list[Excitation]:
    """Return one excitation for each order."""
    source = Source(keys.choice("speed", [source.value for source in Source]))
    per_unit = RPM * _number(keys, "ratio", default=1.0)
    radius = _radius(keys) if source is Source.GROUND else math.nan
    if source is Source.GROUND:
        per_unit *= 60.0 / (2.0 * math.pi * radius)
    orders = keys.numbers("orders")
    names = [f"{name} {order:g}" for order in orders]
    for order_name in names:
        if names.count(order_name) > 1:
            raise keys.error("orders", f"{order_name!r} occurs twice; give each order once.")
    silent = keys.numbers("no_warning") if "no_warning" in keys else []
    for order in silent:
        if order not in orders:
            raise keys.error("no_warning", f"{order:g} is not one of the orders; remove it.")
    for i, order in enumerate(orders):
        keys.refuse_outside(f"orders[{i}]", order, _LEAST, _LARGEST, "give 1e-06 to 1e+06")
    spread, loads = _stddev(keys, "frequency_stddev"), _loads(keys, orders)
    what = _description(keys, name)
    return [
        Excitation(
            order_name,
            source,
            order * per_unit,
            load,
            spread,
            order not in silent,
            None,
            radius,
            f"{what}, {_TIMES.get(order, f'{order:g} times a turn')}",
        )
        for order_name, order, load in zip(names, orders, loads, strict=True)
    ]


def _description(keys: CheckedMapping, name: str) -> str:
    """Return what an excitation is in words; its name if the file has no description."""
    return keys.text("description") if "description" in keys else name.replace("_", " ")


def _ground(keys: CheckedMapping, name: str, read_profile: ReadProfile) -> Excitation:
    """Return the excitation by the ground under the wheels."""
    if keys.choice("speed", [source.value for source in Source]) != Source.GROUND.value:
        raise keys.error("speed", "wheels follow the speed over ground; write `speed: ground`.")
    if "raised" not in keys:
        raise keys.error(
            "raised",
            "this key is missing; write true if no tool is in the soil, or false, and the level is "
            "not known.",
        )
    ground, spectrum, difference = keys["terrain"], None, None
    track = _number(keys, "track", 0.0, _WHEELS[1], unit=" m") if "track" in keys else None
    roughness, exponent, reference, spread = math.nan, 2.0, 0.1, 0.0
    if "class" in ground:
        word = ground.choice("class", list(_CLASSES))
        roughness, spread, name = _CLASSES[word], _WITHIN_CLASS, f"{name} (class {word})"
    elif "profile" in ground:
        file = ground.text("profile")
        if "/" in file or "\\" in file:
            raise ground.error(
                "profile", f"{file} is not beside this file, where a log finds it; copy it there."
            )
        (spectrum, difference), name = read_profile(file), f"{name} ({file})"
        if difference and track is not None:
            raise keys.error("track", f"{file} has both tracks already; remove this key.")
        roughness, exponent = power_law(spectrum, reference)
    elif "roughness" in ground:
        roughness = _number(ground, "roughness", 1e-9, 1.0)
        exponent = _number(ground, "exponent", 1.0, _STEEPEST)
        reference = _number(ground, "reference", 1e-3, 10.0)
    else:
        raise keys.error("terrain", "give a class, a roughness, or a profile.")
    band = keys.interval("band_hz", positive=True) if "band_hz" in keys else (0.3, 20.0)
    for end in band:
        keys.refuse_outside("band_hz", end, 0.01, 1e3, "give 0.01 to 1000 Hz")
    treaded = not {"lugs", "rolling_radius"}.isdisjoint(keys)
    radius, what = _radius(keys) if treaded else math.nan, _description(keys, name)
    pitch = 2.0 * math.pi * radius / keys.integer("lugs") if treaded else None
    law, raised = (roughness, exponent, reference), keys.flag("raised")
    spread = _stddev(keys, "amplitude_stddev", spread)
    terrain = Terrain(*law, band, pitch, raised, spread, spectrum, difference, track)
    return Excitation(name, Source.GROUND, math.nan, None, 0.0, True, terrain, radius, what)


def _radius(keys: CheckedMapping) -> float:
    """Return the rolling radius of a wheel, m."""
    return _number(keys, "rolling_radius", *_WHEELS, unit=" m")


def _loads(keys: CheckedMapping, orders: list[float]) -> list[Load | None]:
    """Return the load of each order; None without amplitudes."""
    kinds = given_kinds(keys)
    if not kinds:
        return [None] * len(orders)
    if len(kinds) > 1:
        raise keys.error(
            kinds[1].key, f"{kinds[0].key} is given too; describe each under a name of its own."
        )
    kind = kinds[0]
    amplitudes = keys.numbers(kind.key)
    if len(amplitudes) != len(orders) or min(amplitudes) < 0.0:
        raise keys.error(
            kind.key, f"give one number for each of the {len(orders)} orders, none below zero."
        )
    place, speed = keys.text("at"), _number(keys, "at_speed")
    exponent = _number(keys, "exponent", -_STEEPEST, _STEEPEST, default=0.0)
    spreads = _stddevs(keys, len(amplitudes))
    return [
        Load(kind, place, value, speed, exponent, spread)
        for value, spread in zip(amplitudes, spreads, strict=True)
    ]


def _stddevs(keys: CheckedMapping, count: int) -> list[float]:
    """Return the deviations of amplitudes: one for all, or one for each."""
    key = "amplitude_stddev"
    if not keys.is_list(key):
        return [_stddev(keys, key)] * count
    values = keys.numbers(key)
    if len(values) != count or not all(0.0 <= value <= 1.0 for value in values):
        raise keys.error(key, f"give one number, or one for each of the {count} orders, 0 to 1.")
    return values


def _stddev(keys: CheckedMapping, key: str, default: float = 0.0) -> float:
    """Return a relative standard deviation."""
    return _number(keys, key, 0.0, 1.0, default=default, unit=", as a part of the value")


def _number(
    keys: CheckedMapping,
    key: str,
    least: float = _LEAST,
    most: float = _LARGEST,
    *,
    default: float | None = None,
    unit: str = "",
) -> float:
    """Return a number from `least` to `most`."""
    hint = f"give {least:g} to {most:g}{unit}"
    return keys.number(key, default=default, least=least, most=most, hint=hint)
