# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The mechanism and table that a node serves, and its answers to requests for more."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism, MechanismError
from linkage_vibration.mechanics.forces import is_force
from linkage_vibration.mechanics.frf import Frf
from linkage_vibration.mechanics.ground_motion import soil_places, transmissibility
from linkage_vibration.mechanics.kinematics import KinematicsError
from linkage_vibration.mechanics.model import LinkageModel, Place, excite_lateral
from linkage_vibration.mechanics.modes import MECHANISM
from linkage_vibration.mechanics.parsing import again_from_mapping
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.ground import (
    FASTEST,
    REASONS,
    GroundTable,
    ground_lines,
    ground_spectrum,
    lateral_mounts,
)
from linkage_vibration.prediction.level_cache import kept_table
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.support.strict_yaml import load_yaml_text
from linkage_vibration.table.table import Table, table_bytes

if TYPE_CHECKING:
    from linkage_vibration.prediction.levels import LevelTable

Places = tuple[Place, ...]

MAX_FREQUENCIES = 10_000
MAX_VALUES = 100_000  # Numbers in one answer; as a message they are 1.6 MB
MAX_GROUND_PLACES = 8  # in one answer about the ground; each takes some tenths of a second

_LINES = 401  # over the band, if no frequencies are given


class ServingError(LinkageVibrationError):
    """A request cannot be answered."""


@dataclass(frozen=True, eq=False)
class ModelWithoutTable:
    """A mechanism without its table."""

    mechanism: Mechanism
    mechanism_text: str  # the mechanism as YAML
    implement: "Implement | None" = None  # in use, if it is not that of the mechanism file
    implements: "Implements | None" = None  # can be chosen by name

    def with_predictor(self, predictor: Predictor, given_file: bytes = b"") -> "LoadedModel":
        """Return the mechanism with what looks up its table, and the file of that."""
        return LoadedModel(**vars(self), predictor=predictor, given_file=given_file)


@dataclass(frozen=True, eq=False)
class LoadedModel(ModelWithoutTable):
    """A mechanism and its table, which are always replaced together."""

    predictor: Predictor = field(kw_only=True)
    given_file: bytes = field(default=b"", kw_only=True)  # of the table, if it was not built here

    @property
    def table(self) -> Table:
        """The table."""
        return self.predictor.table

    @cached_property
    def table_file(self) -> bytes:
        """The table as a file; if it was built, its compression takes some tenths of a second."""
        return self.given_file or table_bytes(self.table)

    @cached_property
    def model(self) -> LinkageModel:
        """The model of the mechanism, which is created when it is first used."""
        return LinkageModel(self.mechanism)


@dataclass(frozen=True, slots=True, eq=False)
class GroundAnswer:
    """Vibration of places by the ground at one angle and speed; NaN where it is not known."""

    outputs: Places
    levels: FloatArray  # (n_out,), rms of velocities, m/s, or forces, N
    accelerations: FloatArray  # (n_out,), rms, m/s2; NaN for forces
    reasons: tuple[str, ...]  # why levels are not known; empty if they are
    off_ground_share: float
    frequencies: FloatArray  # (n_freq,), Hz
    densities: FloatArray  # (n_out, n_freq), of velocities, m2/s2/Hz, or forces, N2/Hz


@dataclass(frozen=True, slots=True, eq=False)
class ModeShapes:
    """Modes at one angle: those in the band of the table, and at least as many as it tracks."""

    natural_frequencies: FloatArray  # (n_modes,), Hz, ascending
    damping_ratios: FloatArray  # (n_modes,), 1
    places: Places  # every point that moves, the left of two, along x, z and in a lateral half y
    positions: FloatArray  # (n_places,), the coordinate of each place in its direction, m
    shapes: FloatArray  # (n_modes, n_places), mass-normalised, 1/sqrt(kg); real parts


@dataclass(frozen=True, slots=True)
class Implement:
    """New properties of a rigid body."""

    rigid_body: str  # empty if there is only one
    mass: float  # kg
    inertia: float  # kg m2, about the centre of gravity
    centre_of_gravity: tuple[float, ...]  # [x, z] in axes of the body, m; empty to keep it
    name: str = ""  # in a file of implements; empty if it has none


@dataclass(frozen=True, slots=True, eq=False)
class Implements:
    """Implements by their names, and the mechanism in which they replace a rigid body."""

    mechanism: Mechanism  # of the mechanism file
    mechanism_text: str
    by_name: dict[str, Implement]

    def find(self, name: str) -> Implement:
        """Return the implement of a name, or raise a `ServingError` that lists the names."""
        if name not in self.by_name:
            raise ServingError(
                f"There is no implement {name!r}; name one of: {', '.join(self.by_name)}."
            )
        return self.by_name[name]


def answer_frf(
    served: LoadedModel,
    alpha3: float,
    outputs: Sequence[str],
    inputs: Sequence[str],
    frequencies: FloatArray,
    *,
    exact: bool,
) -> Frf:
    """Return receptances at an angle (rad) from the table, or from the model if `exact`."""
    table = served.table
    _check_angle(alpha3)
    if bool(outputs) != bool(inputs):
        empty, given = ("inputs", "outputs") if outputs else ("outputs", "inputs")
        raise ServingError(
            f"{given} has places but {empty} is empty; give both, or neither for the drive point."
        )
    valid, forces = table.frf_places, table.forces if table.places else ()
    if exact:
        valid, model = _moving_places(served.mechanism), served.model
        forces = (*model.forces.places, *model.forces.sections) if model.force_places else ()
    soil = [p for p in soil_places(served.mechanism) if p not in valid] if exact else []
    places = (
        _places("outputs", outputs, (*valid, *forces), exact),
        _places("inputs", inputs, (*valid, *soil), exact),
    )
    if not outputs:
        drive = served.mechanism.response
        places = ((drive.point, drive.direction),), ((drive.point, drive.direction),)
    if len(frequencies) == 0:
        frequencies = np.linspace(*table.band, _LINES)
    _check_frequencies(frequencies, None if exact else table.band)
    n_values = len(frequencies) * len(places[0]) * len(places[1])
    if len(frequencies) > MAX_FREQUENCIES or n_values > MAX_VALUES:
        raise ServingError(
            f"{len(frequencies)} frequencies between {len(places[0])} outputs and {len(places[1])} "
            f"inputs are too many for one answer; request at most {MAX_FREQUENCIES} frequencies "
            f"and {MAX_VALUES} numbers."
        )
    if exact:
        with _asked_angle(served, alpha3):
            return _solved_frf(served, alpha3, places, frequencies)
    angle = served.predictor.angle_in_table(alpha3)
    return table.frf(alpha3 if angle is None else angle, *places).at(frequencies)


def _solved_frf(
    served: LoadedModel, alpha3: float, places: tuple[Places, Places], frequencies: FloatArray
) -> Frf:
    """Return receptances, or responses to motions of the soil, of the model."""
    outputs, inputs = places
    soil = set(soil_places(served.mechanism)).difference(_moving_places(served.mechanism))
    if served.model.measured_frequencies is None:
        solution = served.model.halves[excite_lateral(outputs, inputs)].solve(alpha3)
        columns = [
            transmissibility(solution, outputs, into)
            if into in soil
            else solution.frf(outputs, [into])
            for into in inputs
        ]
        values = np.concatenate([column.frf(frequencies) for column in columns], axis=2)
        return Frf(frequencies, outputs, inputs, values, np.zeros(len(outputs)))
    if soil.intersection(inputs):
        raise ServingError(
            "inputs has a motion of the soil, which needs the matrices of every link, but one is "
            "known by its FRFs alone; give points instead."
        )
    return served.model.coupled_frf(alpha3, frequencies, outputs, inputs)


def answer_ground(
    served: LoadedModel,
    excitations: Sequence[Excitation],
    alpha3: float,
    speed: float,
    outputs: Sequence[str],
) -> GroundAnswer:
    """Return levels and spectra by the ground, at an angle (rad) and a speed (m/s), of outputs."""
    terrain = next((excitation.terrain for excitation in excitations if excitation.terrain), None)
    if terrain is None:
        raise ServingError("No excitation has a terrain; describe one in excitation_file.")
    if len(outputs) > MAX_GROUND_PLACES:
        raise ServingError(f"outputs has {len(outputs)} places; name at most {MAX_GROUND_PLACES}.")
    _check_angle(alpha3)
    if not speed <= FASTEST:
        raise ServingError(
            f"ground_speed is {speed:g} m/s; give a speed of at most {FASTEST:g} m/s."
        )
    table, mechanism = served.table, served.mechanism
    drive = mechanism.response
    every = [table, *([table.lateral] if table.lateral and lateral_mounts(mechanism) else [])]
    both = [place for each in every if each.places for place in each.frf_outputs]
    valid = tuple(dict.fromkeys(both))
    places = _places("outputs", outputs, valid, True) or ((drive.point, drive.direction),)
    lines, rows, reasons, densities = ground_lines(terrain), [], [], []
    for place in places:
        force = is_force(place)
        point = None if force else place
        ground = GroundTable(table, mechanism, terrain, [place] if force else [], point)
        motion = ground.at(np.array([alpha3]), np.array([speed]))
        level, acceleration = motion.velocity[0], motion.acceleration[0]
        if force:
            level, acceleration = math.sqrt(motion.forces2[0, 0]), math.nan
        rows.append((level, acceleration, motion.off_ground_share[0]))
        reasons.append(REASONS[motion.reason[0]])
        density = np.full(len(lines), 0.0 * level)  # NaN where the level is not known
        angle = served.predictor.angle_in_table(alpha3)
        if level > 0.0 and angle is not None:
            _, density = ground_spectrum(table, mechanism, terrain, place, angle, speed)
        densities.append(density)
    levels, accelerations, shares = np.array(rows).T
    return GroundAnswer(
        places, levels, accelerations, tuple(reasons), shares[0], lines, np.array(densities)
    )


def answer_mode_shapes(served: LoadedModel, alpha3: float) -> ModeShapes:
    """Solve the models of all halves at an angle (rad) and return their modes."""
    _check_angle(alpha3)
    mechanism, rows = served.mechanism, list[FloatArray]()
    aside = dict(mechanism.lateral.y) if mechanism.lateral else {}
    places, tables = _moving_places(mechanism), served.table.halves
    for model, half in zip(served.model.halves, tables, strict=True):
        with _asked_angle(served, alpha3):
            solution = model.solve(alpha3)
        frequencies, ratios = solution.natural_frequencies, solution.damping_ratios
        elastic = np.flatnonzero(frequencies >= MECHANISM / (2.0 * math.pi))
        in_band = int((frequencies[elastic] <= half.band[1]).sum())
        modes = elastic[: max(in_band, half.n_modes)]
        moved = [i for i, place in enumerate(places) if place[1] in model.interface.directions]
        shapes = np.zeros((len(places), len(frequencies)))
        shapes[moved] = solution.mode_shapes([places[i] for i in moved])
        rows.append(np.vstack([frequencies, ratios, shapes])[:, modes])
    every = np.hstack(rows)
    every = every[:, np.argsort(every[0], kind="stable")]
    positions = []
    for point, direction in places:
        body = mechanism.owners(point)[-1]
        x, z = solution.configuration.place(body, mechanism.local_points(body)[point])
        positions.append({"x": x, "y": aside.get(point, 0.0), "z": z}[direction])
    return ModeShapes(every[0], every[1], places, np.array(positions), every[2:].T)


def with_implement(
    mechanism: Mechanism, mechanism_text: str, implement: Implement
) -> tuple[Mechanism, str]:
    """Return a mechanism and its YAML, without comments, with another implement."""
    name = rigid_body_name(mechanism, implement.rigid_body)
    centre = list(implement.centre_of_gravity)
    if len(centre) not in (0, 2):
        raise ServingError(
            f"centre_of_gravity has {len(centre)} numbers; give [x, z] in m in the axes of "
            f"{name}, or no number to keep the present one."
        )
    mapping = load_yaml_text(mechanism_text)
    numbers: dict[str, Any] = {"mass": implement.mass, "inertia": implement.inertia}
    if centre:
        numbers["centre_of_gravity"] = centre
    # The mapping is copied, as a YAML alias may refer to the same numbers elsewhere.
    bodies = mapping["rigid_bodies"]
    mapping["rigid_bodies"] = {**bodies, name: {**bodies[name], **numbers}}
    lateral = mapping.get("lateral", {})
    if name in lateral.get("inertia", {}):  # A heavier implement is ASSUMED to be as wide.
        share, inertias = implement.mass / bodies[name]["mass"], lateral["inertia"]
        scaled = {of: share * inertias[name][of] for of in ("roll", "yaw")}
        turned = {**inertias[name], **scaled}
        mapping["lateral"] = {**lateral, "inertia": {**inertias, name: turned}}
    if centre and "uncertainty" in mapping:
        mapping["uncertainty"] = _uncertain_centre(mapping["uncertainty"], name)
    what = f"the implement {implement.name}" if implement.name else "another implement"
    text = f"# With {what} instead of that of the original file.\n"
    text += yaml.safe_dump(mapping, sort_keys=False, default_flow_style=None, width=100)
    try:
        return again_from_mapping(mapping, mechanism), text
    except MechanismError as error:
        if not error.path.startswith(f"lateral.inertia.{name}."):
            raise
        low, high = abs(turned["roll"] - turned["yaw"]), turned["roll"] + turned["yaw"]
        raise ServingError(
            f"With {implement.mass:g} kg, {name} would have {turned['roll']:.4g} and "
            f"{turned['yaw']:.4g} kg m2 in roll and yaw, as these change as the mass does, so its "
            f"inertia in pitch cannot be {implement.inertia:g}; give one of {low:.4g} to "
            f"{high:.4g} with it (`replay` takes `--implement-inertia`), or describe this "
            "implement in another mechanism file."
        ) from None


def replaced(served: LoadedModel, wanted: Implement | str) -> ModelWithoutTable:
    """Return a mechanism with another implement; one with a name replaces that of its file."""
    source: LoadedModel | Implements = served
    if isinstance(wanted, str):
        if served.implements is None:
            raise ServingError(
                f"There is no implement {wanted!r}, as implement_file is empty; give the file of "
                "the implements."
            )
        source = served.implements
        wanted = source.find(wanted)
    mechanism, text = with_implement(source.mechanism, source.mechanism_text, wanted)
    name = rigid_body_name(mechanism, wanted.rigid_body)
    centre = next(b.centre_of_gravity for b in mechanism.rigid_bodies if b.name == name)
    implement = replace(wanted, rigid_body=name, centre_of_gravity=centre)
    return ModelWithoutTable(mechanism, text, implement, served.implements)


def _uncertain_centre(claims: dict[str, Any], body: str) -> dict[str, Any]:
    """Return claims of uncertainty with a centre of gravity as [x, z] in place of distances."""
    above = f"rigid_bodies.{body}.centre_of_gravity."
    absolute = claims.get("absolute", {})
    distances = [value for path, value in absolute.items() if path.startswith(above)]
    kinds = {
        kind: {path: v for path, v in claims.get(kind, {}).items() if not path.startswith(above)}
        for kind in ("relative", "absolute")
    }
    kinds["absolute"] |= {f"{above}{i}": max(distances) for i in (0, 1) if distances}
    pairs = claims.get("correlations", [])
    kept = [p for p in pairs if not any(path.startswith(above) for path in p["between"])]
    return kinds | ({"correlations": kept} if kept else {})


def progress_file(wanted: Path) -> Path:
    """Return the file in which `rebuilt` writes the finished fraction of its table."""
    return wanted.with_suffix(".progress")


def rebuilt(
    mechanism: Mechanism, like: Table, excitations: Sequence[Excitation], wanted: Path
) -> "tuple[Predictor, LevelTable]":
    """Load or build tables of a changed mechanism, like the old one, while ``wanted`` exists."""

    def check(finished: float) -> None:
        if not wanted.exists():
            raise ServingError("Building the table was cancelled.")
        progress_file(wanted).write_text(f"{finished:.3f}")

    from linkage_vibration.prediction.levels import kept_levels
    from linkage_vibration.table.tabulation import TOLERANCE, build_table

    check(0.0)
    tolerance = max(TOLERANCE, float(like.interpolation_error.max()))
    points = tuple(dict.fromkeys(point for point, _ in like.places))
    build = partial(build_table, LinkageModel(mechanism), tolerance, points, check)
    predictor = Predictor(kept_table(mechanism, build, tolerance, points))
    levels = kept_levels(predictor, mechanism, excitations)
    levels.prepare()
    return predictor, levels


def place_name(place: Place) -> str:
    """Return the name of a place in requests and answers, such as "E1.z"."""
    return ".".join(place)


@contextmanager
def _asked_angle(served: LoadedModel, alpha3: float) -> Iterator[None]:
    """Say of an error of the model that the angle of the request is its cause."""
    try:
        yield
    except (KinematicsError, MechanismError) as error:
        first, last = np.degrees(served.table.alpha3_range)
        why = str(error).partition(";")[0].rstrip(".")
        raise ServingError(
            f"The linkage cannot be at {math.degrees(alpha3):.4g} deg ({why}); give a crank_angle "
            f"of the table, {first:.4g} to {last:.4g} deg."
        ) from None


def _check_angle(alpha3: float) -> None:
    if not math.isfinite(alpha3):
        raise ServingError(f"crank_angle is {alpha3}; give a finite angle in rad.")


def rigid_body_name(mechanism: Mechanism, asked: str) -> str:
    """Return the name of the rigid body that a request means; an empty name means the only one."""
    names = [body.name for body in mechanism.rigid_bodies]
    if not names:
        raise ServingError(
            f"{mechanism.name} has no rigid body to change; describe the implement under "
            "rigid_bodies."
        )
    if asked == "" and len(names) > 1:
        raise ServingError(f"rigid_body is empty; name one of: {', '.join(names)}.")
    if asked not in ("", *names):
        raise ServingError(f"There is no rigid body {asked!r}; name one of: {', '.join(names)}.")
    return asked or names[0]


def _moving_places(mechanism: Mechanism) -> Places:
    """Return every point that can vibrate, along x and z, and along y in the lateral half."""
    directions = "xyz" if mechanism.lateral else "xz"
    return tuple((p, direction) for p in mechanism.moving_points for direction in directions)


def _places(where: str, names: Sequence[str], valid: Sequence[Place], exact: bool) -> Places:
    """Return places by their names."""
    by_name = {place_name(place): place for place in valid}
    for i, name in enumerate(names):
        if name not in by_name:
            remedy = "" if exact else ", or set exact to use the model"
            raise ServingError(
                f"{where}[{i}] is {name!r}; name one of {', '.join(by_name) or '(none)'}{remedy}."
            )
    return tuple(by_name[name] for name in names)


def _check_frequencies(frequencies: FloatArray, band: tuple[float, float] | None) -> None:
    """Refuse frequencies that are negative, not finite, or outside the band of the table."""
    low, high = (0.0, math.inf) if band is None else band
    bad = np.flatnonzero(~(np.isfinite(frequencies) & (frequencies >= low) & (frequencies <= high)))
    if len(bad):
        first, remedy = int(bad[0]), "give finite frequencies of at least 0 Hz"
        if band is not None and 0.0 <= frequencies[first] < math.inf:
            remedy = f"the table holds from {low:g} to {high:g} Hz; set exact for others"
        raise ServingError(f"frequencies[{first}] is {frequencies[first]:g} Hz; {remedy}.")
