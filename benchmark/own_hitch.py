# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Makes the pictures and figures of docs/your_own_hitch.md: ``python -m benchmark own_hitch``."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmark.report import machine, publish, table
from linkage_vibration.drawing.palette import COLOURS, GREY, INK
from linkage_vibration.drawing.plots import tidy
from linkage_vibration.drawing.pose_picture import draw_linkage
from linkage_vibration.mechanics.description import Cylinder
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.paths import number_at, with_numbers
from linkage_vibration.readers.mechanism import load_yaml
from linkage_vibration.studies.pose import pin_places
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table
from test.support.in_plane import IN_PLANE, in_plane

PICTURES = Path(__file__).parents[1] / "docs" / "pictures"
LINKAGES = ("three_point_linkage", "three_point_linkage_on_tractor")
ANGLES = (90.0, 135.0, 180.0)  # deg
TURN = 0.030  # m, of an adjustment
ERROR = 0.010  # m, of a pin
AT = 135.0  # deg, of the pictures
# What the tape measures, in the order of the guide: between which pins, and where the file has it.
MEASURED = {
    "P1 to P3": (("P1", "P3"), "ground.P3.0, ground.P3.1"),
    "P1 to P2": (("P1", "P2"), "ground.P2.0, ground.P2.1"),
    "P3 to V2": (("P3", "V2"), "links.input_crank.points.V2"),
    "P1 to V1": (("P1", "V1"), "links.lower_link.points.V1"),
    "P1 to E1": (("P1", "E1"), "links.lower_link.points.E1"),
    "V2 to V1": (("V2", "V1"), "links.lift_rod.points.V1"),
    "P2 to E2": (("P2", "E2"), "links.upper_link.points.E2"),
    "E1 to E2": (("E1", "E2"), "rigid_bodies.implement.points.E2.0"),
}


def changed(name: str, path: str, by: float) -> LinkageModel:
    """Return a shipped linkage with one length longer; two coordinates move along their line."""
    mapping = in_plane(load_yaml(config_file(f"{name}.yaml"))[0])
    paths = [part.strip() for part in path.split(",")]
    old = [number_at(mapping, part) for part in paths]
    factor = 1.0 + by / math.hypot(*old)
    new = zip(paths, [value * factor for value in old], strict=True)
    return LinkageModel(mechanism_from_mapping(with_numbers(mapping, new)))


def frequencies(model: LinkageModel, angle_deg: float, n_modes: int) -> np.ndarray:
    """Return the first natural frequencies at an angle, (n_modes,), Hz."""
    return model.solve(math.radians(angle_deg)).natural_frequencies[:n_modes]


def adjustments(name: str) -> str:
    """Return a table of what 30 mm of the two adjustable links change, in percent."""
    modes = load_table(config_file(f"tables/{name}.npz")).vertical.mode_names
    plain, rows = changed(name, MEASURED["V2 to V1"][1], 0.0), []
    for link, pins in (("lift rod", "V2 to V1"), ("upper link", "P2 to E2")):
        for by in (TURN, -TURN):
            other = changed(name, MEASURED[pins][1], by)
            for angle in ANGLES:
                before, after = (frequencies(model, angle, len(modes)) for model in (plain, other))
                cells = [f"{100.0 * change:+.1f}" for change in after / before - 1.0]
                rows.append([f"{link} {1000.0 * by:+.0f} mm", f"{angle:.0f}", *cells])
    return table(["adjustment", "alpha3, deg", *modes], rows)


def wrong_pins(name: str) -> tuple[list[list[float]], str]:
    """Return what 10 mm in each length change over the stroke, and the same as a table.

    The columns are the height of the lower link's end (mm), and the first mode of the linkage (%).
    """
    modes = load_table(config_file(f"tables/{name}.npz")).vertical.mode_names
    mode = next(i for i, label in enumerate(modes) if not label.startswith("tractor"))
    plain = changed(name, MEASURED["V2 to V1"][1], 0.0)
    result, rows = [], []
    for label, (_, path) in MEASURED.items():
        other, changes = changed(name, path, ERROR), []
        for angle in ANGLES:
            heights = [
                pin_places(m.mechanism, m.kinematics.at(math.radians(angle)))["E1"][1]
                for m in (plain, other)
            ]
            pair = [frequencies(m, angle, mode + 1)[mode] for m in (plain, other)]
            changes.append([1000.0 * (heights[1] - heights[0]), 100.0 * (pair[1] / pair[0] - 1.0)])
        result.append([max((row[k] for row in changes), key=abs) for k in (0, 1)])
        cells = [f"{row[0]:+.0f} mm, {row[1]:+.1f} %" for row in changes]
        rows.append([label, *cells])
    heads = [f"at {angle:.0f} deg" for angle in ANGLES]
    return result, table([f"{1000.0 * ERROR:.0f} mm more in", *heads], rows)


def draw_pins(picture: Path) -> None:
    """Draw the linkage with the lengths that a tape measures, numbered in their order."""
    model = changed(LINKAGES[1], MEASURED["V2 to V1"][1], 0.0)
    figure = Figure(figsize=(9.0, 4.6), dpi=110, layout="constrained")
    ax = figure.subplots()
    draw_linkage(ax, model, math.radians(AT))
    places = pin_places(model.mechanism, model.kinematics.at(math.radians(AT)))
    for number, (pins, _) in enumerate(MEASURED.values(), 1):
        first, second = (places[pin] for pin in pins)
        if number <= 2:
            ax.plot(*np.array([first, second]).T, ":", color=GREY, lw=1.5)
        share = 0.3 if pins == ("P1", "E1") else 0.55
        x, z = first + (0.75 if pins == ("P1", "E1") else share) * (second - first)
        box = {"boxstyle": "circle,pad=0.25", "fc": "white", "ec": INK}
        ax.annotate(str(number), (x, z), ha="center", va="center", fontsize=9, bbox=box, zorder=5)
    ax.set_xlim(-1.95, 0.3)
    ax.set_ylim(-0.2, 0.75)
    ax.legend(frameon=False, loc="upper left", fontsize=9)
    ax.set_title("The lengths to measure, in their order", loc="left")
    figure.savefig(picture)


def draw_cylinder_and_tyres(picture: Path) -> None:
    """Draw the ends of a lift cylinder in the axes of their bodies, and the axles on tyres."""
    model = changed(LINKAGES[1], MEASURED["V2 to V1"][1], 0.0)
    figure = Figure(figsize=(12.0, 5.0), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.35])
    draw_cylinder(left, model)
    draw_tyres(right, model)
    for ax in (left, right):
        ax.set(xlabel="x, forward [m]", ylabel="z, up [m]", aspect="equal")
        tidy(ax)
    figure.savefig(picture)


def draw_cylinder(ax: Axes, model: LinkageModel) -> None:
    """Draw the lift arm and a cylinder with the coordinates of its ends."""
    at, spring = model.kinematics.at(math.radians(AT)), model.mechanism.springs[0]
    assert isinstance(spring.stiffness, Cylinder)
    assert spring.stiffness.ends is not None
    (x, z), (along_arm, beside) = spring.stiffness.ends
    places = pin_places(model.mechanism, at)
    pin, foot = places["P3"], np.array([x, z])
    head, corner = (at.place("input_crank", (along_arm, side)) for side in (beside, 0.0))
    ax.plot(*np.array([pin, places["V2"]]).T, color=COLOURS[0], lw=4, label="lift arm (crank)")
    ax.plot(*np.array([foot, head]).T, color=COLOURS[1], lw=7, alpha=0.6, label="lift cylinder")
    along = (head - foot) / math.dist(head, foot)
    nearest = foot + along * ((pin - foot) @ along)
    ax.plot(*np.array([pin, nearest]).T, "--", color=INK, lw=1.4, label="lever")
    for first, last, colour in (
        (pin, corner, INK),
        (corner, head, INK),
        (np.zeros(2), np.array([x, 0.0]), GREY),
        (np.array([x, 0.0]), foot, GREY),
    ):
        style = {"arrowstyle": "->", "color": colour, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", tuple(last), tuple(first), arrowprops=style, zorder=4)
    note(
        ax,
        f"rod_end: [{along_arm:g}, {beside:g}],\nfrom P3 along the\nlift arm and beside it",
        head,
        -12,
    )
    note(ax, f"base_end: [{x:g}, {z:g}],\nfrom the origin of the\nground, here P1", foot, 12)
    for name in ("P1", "P3", "V2"):
        ax.plot(*places[name], "o", color="white", mec=INK, markersize=8, zorder=3)
        note(ax, name, places[name], -10 if name == "P1" else 10)
    ax.legend(frameon=False, loc="lower left", fontsize=9)
    ax.set_title("The ends of a lift cylinder", loc="left")
    ax.set(xlim=(-0.45, 0.4), ylim=(-0.08, 0.6))


def draw_tyres(ax: Axes, model: LinkageModel) -> None:
    """Draw the linkage with the axles of its tractor."""
    base = model.mechanism.base
    assert base is not None
    soil, outline = (
        -0.85,
        np.array([[0.0, 0.0], [0.2, 0.7], [3.4, 0.7], [3.4, -0.05], [0.3, -0.05]]),
    )
    ax.fill(*outline.T, color=GREY, alpha=0.2, linewidth=0)
    draw_linkage(ax, model, math.radians(AT))
    for text in list(ax.texts):  # Names of pins would cover one another at this scale.
        text.remove()
    note(ax, "P1", np.zeros(2), 10)
    for mount in base.mounts:
        (x, z), name = mount.at, mount.name.replace("_", " ")
        wave = 0.08 * np.array([0, 0, *[1, -1] * 4, 1, 0, 0])
        ax.plot(x + wave, np.linspace(soil, z, len(wave)), color=COLOURS[1], lw=1.5)
        ax.plot(x, z, "s", color=COLOURS[1], markersize=8)
        note(ax, f"{name}\nat: [{x:g}, {z:g}],\ntyre or stiffness", np.array([x, z - 0.45]), 14)
    x, z = base.body.centre_of_gravity
    ax.plot(x, z, "P", color=INK, markersize=10)
    note(ax, f"centre_of_gravity:\n[{x:g}, {z:g}]", np.array([x, z + 0.2]), 10)
    ax.axhline(soil, color=INK, lw=2)
    ax.set_title("The tractor on its tyres, in the axes of the ground", loc="left")
    ax.set(xlim=(-2.0, 4.4), ylim=(-1.0, 1.1))


def note(ax: Axes, text: str, place: np.ndarray, offset: int) -> None:
    """Write a text beside a place: on its right, or with a negative offset on its left."""
    side = "left" if offset > 0 else "right"
    style: Any = {"textcoords": "offset points", "ha": side, "va": "center", "fontsize": 9}
    ax.annotate(text, tuple(place), (offset, 0), zorder=6, **style)


def draw_wrong_pins(picture: Path, result: list[list[float]]) -> None:
    """Draw how 10 mm in each length move the implement and the first mode of the linkage."""
    figure = Figure(figsize=(9.0, 4.2), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    rows = np.arange(len(MEASURED))
    bars(
        left,
        rows,
        [row[0] for row in result],
        COLOURS[0],
        "largest change of the height of E1 [mm]",
    )
    bars(
        right,
        rows,
        [row[1] for row in result],
        COLOURS[1],
        "largest change of mode 1, implement heave [%]",
    )
    left.set_yticks(rows, [f"{i}  {label}" for i, label in enumerate(MEASURED, 1)])
    left.invert_yaxis()
    figure.suptitle("A length that is 10 mm too long", x=0.01, ha="left")
    figure.savefig(picture)


def bars(ax: Axes, rows: np.ndarray, values: list[float], colour: str, label: str) -> None:
    """Draw horizontal bars with their values."""
    ax.barh(rows, values, color=colour, height=0.6)
    for row, value in zip(rows.tolist(), values, strict=True):
        offset, side = ((4, 0), "left") if value >= 0 else ((-4, 0), "right")
        ax.annotate(
            f"{value + 0.0:+.1f}".replace("-0.0", "+0.0"),
            (value, row),
            offset,
            textcoords="offset points",
            ha=side,
            va="center",
        )
    ax.axvline(0.0, color=INK, lw=0.8)
    ax.margins(x=0.2)
    ax.set_xlabel(label)
    tidy(ax)


def main() -> None:
    """Compute the tables, draw the pictures, and write the page."""
    result, wrong = wrong_pins(LINKAGES[0])
    draw_pins(PICTURES / "own_hitch_pins.png")
    draw_wrong_pins(PICTURES / "own_hitch_wrong_pins.png", result)
    draw_cylinder_and_tyres(PICTURES / "own_hitch_cylinder.png")
    parts = [
        "This page shows what the adjustable links and errors of the tape measure change in the "
        "shipped hitches, at the same crank angle.",
        IN_PLANE,
    ]
    for name in LINKAGES:
        text = "Changes of the natural frequencies in percent:"
        parts += [f"## Adjustments: {name}", text, adjustments(name)]
    text = (
        "Height of the lower link's end E1, and natural frequency of the first mode that is not "
        "the tractor's:"
    )
    parts += [f"## Wrong lengths: {LINKAGES[0]}", text, wrong]
    publish("own_hitch", "Your own hitch", parts, machine())


if __name__ == "__main__":
    main()
