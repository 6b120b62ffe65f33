# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Near a toggle: loop closure, velocity ratios, natural frequencies and the table."""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.report import table
from linkage_vibration.drawing.palette import COLOURS, GREY
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import Kinematics, KinematicsError
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import TableError
from linkage_vibration.table.tabulation import build_table

TITLE = "Toggle: the linkage locks"

FloatArray = NDArray[np.float64]
Array = NDArray[Any]

_LINKAGES = {
    "as printed": "three_point_linkage_as_printed.yaml",
    "default": "three_point_linkage.yaml",
}
_ENDS = {"as printed": (184.938, -56.345), "default": (203.703, -63.294)}  # deg, for the words
_CRANK_ERROR = math.radians(0.1)


def section(pictures: Path) -> str:
    """Measure, draw, and return the section."""
    models = {
        name: LinkageModel(read_mechanism(config_file(file))) for name, file in _LINKAGES.items()
    }
    printed = models["as printed"].mechanism
    errors = _closure_errors(printed)
    changes = {
        f"{name}, {end:g} deg": _first_mode(model, upper)
        for name, model in models.items()
        for end, upper in zip(_ENDS[name], (True, False), strict=True)
    }
    ratios = {
        f"{name}, {end:g} deg": _velocity_ratios(model.kinematics, upper)
        for name, model in models.items()
        for end, upper in zip(_ENDS[name], (True, False), strict=True)
    }
    _draw(errors, ratios, changes, pictures / "toggle.png")
    return "\n\n".join(
        [
            "At a toggle two bars are in line, here the upper link and the mast. alpha3 has an "
            "extremum there. Therefore every angle of the linkage changes with the square root of "
            "the distance to it, and velocity ratios grow with its inverse. "
            f"**Beyond it** {_beyond(printed)}",
            "**Loop closure.** The next table shows the error of the mast's angle (rad) of the "
            "as-printed linkage before 184.938 deg, compared with extended precision. Rounding "
            "alone causes eps / sqrt(distance) with every method. Newton's method on the gaps of "
            "the pins loses another half of the digits if it stops when they are below 1 nm, since "
            "a gap is the square of an angle here. Ours stops when its steps no longer decrease.",
            _closure_table(errors),
            f"**Natural frequencies.** {_locking(models['as printed'])} The next table shows by "
            "how much an error of 0.1 deg in the crank angle changes the first one, for each "
            "toggle. Near a toggle it is error / (2 distance). To stay within 1 %, keep a distance "
            f"of {_keep(changes, 0.01)}; to stay within 5 %, {_keep(changes, 0.05)}.",
            _change_table(changes),
            f"**The table.** {_tables(models['as printed'].mechanism)}",
            "**What is reported.** A prediction within 1 deg of a toggle has the status "
            "`NEAR_TOGGLE`; `Configuration.toggle_distance` is the distance. **What is rejected.** "
            "If a stroke touches or crosses a toggle, building the model fails, and the error "
            "names the angle and the bars in line. If an angle is beyond a toggle, the error names "
            "the nearest angle at which the linkage closes (`KinematicsError`).",
            "![Errors, velocity ratios and sensitivity near the toggles](stability/toggle.png)",
            "Tests: `test/mechanics/test_kinematics.py`: `test_digits_lost_near_a_toggle`, "
            "`test_first_frequency_vanishes_at_a_toggle`, `test_stroke_past_a_toggle_is_refused`, "
            "`test_stroke_over_a_gap_is_refused`, `test_nearly_a_parallelogram`.",
        ]
    )


def place_mast(mechanism: Mechanism, alpha3: float, number: type = float) -> Any:
    """Return the mast's angle by intersecting circles, computed in a given kind of number."""
    p1, p2, p3 = (np.array([number(c) for c in place]) for _, place in mechanism.ground)
    crank, rod, lower, v1_at, upper, mast = (number(length) for length in _lengths(mechanism))
    alpha = number(alpha3)
    v2 = p3 + crank * np.array([np.cos(alpha), np.sin(alpha)])
    e1 = p1 + (_circles(p1, v1_at, v2, rod) - p1) * lower / v1_at
    e2 = _circles(e1, mast, p2, upper)
    return np.arctan2(*(e2 - e1)[::-1])


def _circles(first: Array, radius: Any, second: Array, other: Any) -> Array:
    """Return where two circles meet, left of the way from the first centre to the second."""
    way = second - first
    distance = np.sqrt((way**2).sum())
    along = (radius**2 - other**2 + distance**2) / (2 * distance)
    across = np.sqrt(radius**2 - along**2)
    return np.asarray(first + (along * way + across * np.array([-way[1], way[0]])) / distance)


def newton(
    mechanism: Mechanism, alpha3: float, angles: FloatArray, stop: float
) -> tuple[FloatArray, int]:
    """Plain Newton for the other bars' angles at an input angle, from those of an angle before.

    Parameters
    ----------
    mechanism : Mechanism
        The three-point linkage.
    alpha3 : float
        rad.
    angles : ndarray, (4,)
        Of lower link, upper link, lift rod and mast, to start from.
    stop : float
        Gap at the pins, m, below which it is done.

    Returns
    -------
    angles : ndarray, (4,)
        Solved for, or of the last step.
    steps : int
        20 if it did not converge.
    """
    p1, p2, p3 = (np.array(place) for _, place in mechanism.ground)
    crank, rod, lower, v1_at, upper, mast = _lengths(mechanism)
    v2 = p3 + crank * np.array([math.cos(alpha3), math.sin(alpha3)])
    for steps in range(20):
        along = np.array([np.cos(angles), np.sin(angles)])
        across = np.array([-along[1], along[0]])
        gaps = np.concatenate(
            [
                p1 + v1_at * along[:, 0] - v2 - rod * along[:, 2],
                p1 + lower * along[:, 0] + mast * along[:, 3] - p2 - upper * along[:, 1],
            ]
        )
        if np.abs(gaps).max() < stop:
            return angles, steps
        matrix = np.zeros((4, 4))
        matrix[:2, 0], matrix[:2, 2] = v1_at * across[:, 0], -rod * across[:, 2]
        matrix[2:, 0], matrix[2:, 1] = lower * across[:, 0], -upper * across[:, 1]
        matrix[2:, 3] = mast * across[:, 3]
        angles = angles - np.linalg.solve(matrix, gaps)
    return angles, 20


def _lengths(mechanism: Mechanism) -> tuple[float, ...]:
    """Crank, lift rod, lower link, its V1, upper link and mast, m."""
    at = {link.name: dict(link.points) for link in mechanism.links}
    return (
        at["input_crank"]["V2"][0],
        at["lift_rod"]["V1"][0],
        at["lower_link"]["E1"][0],
        at["lower_link"]["V1"][0],
        at["upper_link"]["E2"][0],
        dict(mechanism.rigid_bodies[0].points)["E2"][0],
    )


def _angles(kinematics: Kinematics, alpha3: float) -> FloatArray:
    """Return the angles that `newton` starts from."""
    configuration = kinematics.at(alpha3)
    bodies = ("lower_link", "upper_link", "lift_rod", "implement")
    return np.array([configuration.angle(body) for body in bodies])


@dataclasses.dataclass(frozen=True)
class _Errors:
    """Errors of the mast's angle (rad), method by method, and its velocity ratio."""

    distance_deg: FloatArray
    methods: dict[str, FloatArray]
    velocity_ratio: FloatArray


def _closure_errors(mechanism: Mechanism) -> _Errors:
    """Measure each method's error closer and closer to the upper toggle."""
    kinematics = Kinematics(mechanism)
    toggle = kinematics.closable_range[1]
    distance_deg = 10.0 ** np.arange(1, -12, -1.0)
    names = ("circles", "Newton, gaps below 1 nm", "Newton, gaps below 1e-14 m", "ours")
    errors: dict[str, list[float]] = {name: [] for name in names}
    ratios = []
    for distance in np.radians(distance_deg):
        alpha3 = float(toggle - distance)
        before = _angles(kinematics, float(toggle - min(10.0 * distance, 0.25)))
        exact = place_mast(mechanism, alpha3, np.longdouble)
        ours = kinematics.at(alpha3)
        result = (
            place_mast(mechanism, alpha3),
            newton(mechanism, alpha3, before, 1e-9)[0][3],
            newton(mechanism, alpha3, before, 1e-14)[0][3],
            ours.angle("implement"),
        )
        for name, angle in zip(names, result, strict=True):
            errors[name].append(float(abs(np.longdouble(angle) - exact)))
        ratios.append(ours.velocity_ratio("implement"))
    return _Errors(
        distance_deg, {name: np.array(values) for name, values in errors.items()}, np.array(ratios)
    )


def _closure_table(errors: _Errors) -> str:
    rows = []
    for i in range(0, len(errors.distance_deg), 2):
        distance = math.radians(errors.distance_deg[i])
        cells = [f"{values[i]:.0e}" for values in errors.methods.values()]
        least = np.finfo(float).eps / math.sqrt(distance)
        ratio = f"{errors.velocity_ratio[i]:.3g}"
        rows.append([f"{errors.distance_deg[i]:g}", *cells, f"{least:.0e}", ratio])
    return table(
        ["distance, deg", *errors.methods, "eps / sqrt(distance)", "mast's velocity ratio"], rows
    )


def _beyond(mechanism: Mechanism) -> str:
    """Return what each method gives half a degree beyond the toggle."""
    kinematics = Kinematics(mechanism)
    toggle = kinematics.closable_range[1]
    alpha3 = toggle + math.radians(0.5)
    with np.errstate(invalid="ignore"):
        by_circles = place_mast(mechanism, alpha3)
    angles, steps = newton(mechanism, alpha3, _angles(kinematics, toggle - math.radians(0.5)), 1e-9)
    turned = abs(angles[3] - _angles(kinematics, toggle - math.radians(0.5))[3])
    ours = _message(lambda: kinematics.at(alpha3))
    return (
        f"(by 0.5 deg) the circles do not meet: the mast's angle is `{by_circles}`. Newton's "
        f"method, started from the previous angle, fails after {steps} steps, with the mast "
        f"{math.degrees(turned):.0f} deg off. Ours reports: *{ours}*"
    )


def _message(call: Callable[[], object]) -> str:
    try:
        call()
    except (KinematicsError, TableError) as error:
        return str(error)
    raise AssertionError("it was to be refused")


def _first_mode(model: LinkageModel, upper: bool) -> FloatArray:
    """Distance (deg), first natural frequency (Hz) and its change, (n, 3).

    The change is by the crank error towards the toggle or away, the larger, relative.
    """
    toggle = model.kinematics.closable_range[1 if upper else 0]
    way = -1.0 if upper else 1.0
    rows = []
    for distance in np.radians([20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2]):
        here, *off = (
            model.solve(float(toggle + way * (distance + error)))
            for error in (0.0, -_CRANK_ERROR, _CRANK_ERROR)
        )
        first = here.natural_frequencies[0]
        change = max(abs(other.natural_frequencies[0] / first - 1.0) for other in off)
        rows.append([math.degrees(distance), first, change])
    return np.array(rows)


def _velocity_ratios(kinematics: Kinematics, upper: bool) -> FloatArray:
    """Distance (deg) and how many times faster than the crank the mast turns, (n, 2)."""
    toggle, way = (kinematics.closable_range[upper], -1.0 if upper else 1.0)
    distances = 10.0 ** np.linspace(1.3, -4.0, 54)
    result = [kinematics.at(float(toggle + way * d)) for d in np.radians(distances)]
    return np.column_stack(
        [distances, [abs(turned.velocity_ratio("implement")) for turned in result]]
    )


def _change_table(changes: dict[str, FloatArray]) -> str:
    distances = next(iter(changes.values()))[:, 0]
    rows = [
        [
            f"{distance:g}",
            *(
                f"{100.0 * values[i, 2]:.1f} % of {values[i, 1]:.2f} Hz"
                for values in changes.values()
            ),
            f"{100.0 * math.degrees(_CRANK_ERROR) / (2.0 * distance):.1f} %",
        ]
        for i, distance in enumerate(distances)
    ]
    return table(["distance, deg", *changes, "0.1 deg / (2 distance)"], rows)


def _keep(changes: dict[str, FloatArray], share: float) -> str:
    """Return the least measured distance beyond which no change is larger than a limit."""
    worst = np.max([values[:, 2] for values in changes.values()], axis=0)
    fine = np.logical_and.accumulate(worst <= share)
    return f"{next(iter(changes.values()))[fine, 0][-1]:g} deg"


def _locking(model: LinkageModel) -> str:
    """Return a text about the first modes near a toggle."""
    toggle = model.kinematics.closable_range[1]
    whole = LinkageModel(model.mechanism, reduced=False)
    words = []
    for distance in (1e-2, 1e-6, 1e-10):
        alpha3 = toggle - math.radians(distance)
        ours, other = (each.solve(alpha3).natural_frequencies[0] for each in (model, whole))
        words.append(f"{distance:g} deg before it {ours:.2g} Hz ({other:.2g})")
    return (
        "With the two bars in line, the mast can move while the crank is at rest. Therefore the "
        "first mode falls to 0 Hz with the square root of the distance: "
        f"{', '.join(words)}. The values in brackets are without reduction; below about 1e-5 Hz "
        "they are rounding. All other modes have a limit."
    )


def _tables(mechanism: Mechanism) -> str:
    """Build tables from 170 deg up to angles closer and closer to the toggle."""
    toggle = Kinematics(mechanism).closable_range[1]
    words = []
    for distance in (5.0, 1.0, 0.1, 0.01, 1e-4):
        stroke = math.radians(170.0), toggle - math.radians(distance)
        model = LinkageModel(dataclasses.replace(mechanism, stroke=stroke))
        try:
            made = build_table(model, tolerance=1e-6)
            worst = float(made.interpolation_error.max())
            words.append(f"{distance:g} deg before it, {len(made.alpha3)} points ({worst:.0e})")
        except TableError as error:
            words.append(f"{distance:g} deg before it: *{error}*")
    return (
        "Polynomials in alpha3 cannot approximate a square root. Polynomials in an angle x, with "
        "alpha3 = middle - half range cos x between the two toggles, can. From 170 deg, for a "
        "tolerance of 1e-6 (in brackets the measured relative error): " + "; ".join(words)
    )


def _draw(
    errors: _Errors, ratios: dict[str, FloatArray], changes: dict[str, FloatArray], picture: Path
) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 3.0), dpi=110, layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    markers = ("o", "v", "^", "s")
    for (name, values), colour, marker in zip(
        errors.methods.items(), COLOURS, markers, strict=False
    ):
        left.loglog(errors.distance_deg, values, marker, color=colour, ms=5, label=name)
    least = np.finfo(float).eps / np.sqrt(np.radians(errors.distance_deg))
    left.loglog(errors.distance_deg, least, color=GREY, lw=1, label="eps / sqrt(distance)")
    left.set_ylim(1e-17, 1e4)
    left.set_xticks(10.0 ** np.arange(1, -12, -4))
    left.set_title("Loop closure, as printed", fontsize=10)
    left.set_ylabel("error of the mast's angle, rad")
    left.legend(fontsize=7, loc="upper right")

    lines = ("-", "--", "-.", ":")
    for name, colour, line in zip(changes, COLOURS, lines, strict=False):
        middle.loglog(*ratios[name].T, line, color=colour, label=name)
        right.loglog(changes[name][:, 0], 100.0 * changes[name][:, 2], line, color=colour)
    distance = next(iter(ratios.values()))[:, 0]
    middle.loglog(distance, 1.0 / np.sqrt(distance), color=GREY, lw=1, label="slope -1/2")
    middle.set_title("Mast's velocity ratio", fontsize=10)
    middle.set_ylabel("|d(mast's angle) / d(alpha3)|")
    middle.legend(fontsize=7, loc="lower right")
    distance = next(iter(changes.values()))[:, 0]
    half = 100.0 * math.degrees(_CRANK_ERROR) / (2.0 * distance)
    right.loglog(distance, half, color=GREY, lw=1, label="0.1 deg / (2 distance)")
    right.set_title("Crank off by 0.1 deg", fontsize=10)
    right.set_ylabel("change of the first frequency, %")
    right.legend(fontsize=7, loc="lower right")
    for ax in (left, middle, right):
        ax.set_xlabel("distance from the toggle, deg")
        ax.invert_xaxis()
    figure.savefig(picture, format="png")
