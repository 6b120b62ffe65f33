# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Doubts about numbers that are valid, on both sides of each threshold, by statics on paper.

The simple tractor has its axles at -3 and -0.5 m, and its mass of 4000 kg at -2 m. A body on it
turns about the origin, with its mass 0.8 m ahead and a strut to a point 1 m ahead.
"""

import copy
import math
import re
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from linkage_vibration.cli import pose
from linkage_vibration.cli.arguments import read_levels
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.prediction.doubts import (
    excitation_doubts,
    linkage_doubts,
    load_ratio_doubt,
    tabulated_doubts,
)
from linkage_vibration.prediction.excitation import excitations_from_mapping
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.settings import Parameters, with_values
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.studies.pose import axle_rows
from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file
from linkage_vibration.table.table import TableError, load_table
from linkage_vibration.table.tabulation import build_table
from test.mechanics.test_forces import LEVER
from test.support.in_plane import in_plane

AXLE = {"stiffness": [7e5, 7e5], "damping": [4e3, 4e3]}
TRACTOR: dict[str, Any] = {
    **LEVER,
    "base": {
        "mass": 4000.0,
        "inertia": 6000.0,
        "centre_of_gravity": [-2.0, -0.5],
        "mounts": {"rear": {"at": [-3.0, -1.0], **AXLE}, "front": {"at": [-0.5, -1.0], **AXLE}},
    },
}
DOCS = Path(__file__).parents[2] / "docs"
COUNTS = "lower_link", "input_crank", "lift_rod"


def tractor(mass: float = 12.0, centre: float = -2.0, **deviations: float) -> dict[str, Any]:
    """Return the simple tractor with a body of another mass, kg, and its centre of gravity, m."""
    content = copy.deepcopy(TRACTOR)
    content["rigid_bodies"]["bob"] |= {"mass": mass, "inertia": 0.25 * mass}
    content["base"]["centre_of_gravity"][0] = centre
    names = {"place": "base.centre_of_gravity.0", "mass_of_base": "base.mass"}
    content["uncertainty"] = {"absolute": {names[key]: v for key, v in deviations.items()}}
    return content


def doubts(content: dict[str, Any]) -> str:
    """Return what is doubtful about a description."""
    return " ".join(linkage_doubts(LinkageModel(mechanism_from_mapping(content))))


def test_axle_loads_are_those_on_paper() -> None:
    """Moments about the rear axle: (4000 x 1.0 + 1000 x 3.8) / 2.5 = 3120 kg are on the front."""
    model = LinkageModel(mechanism_from_mapping(tractor(1000.0)))
    words, head, row = axle_rows(model, [0.0]).splitlines()
    assert "weighbridge" in words
    assert head.split() == ["alpha3", "rear", "[kg]", "front", "[kg]"]
    assert row.split() == ["0.00", "1880", "3120"]


def test_an_axle_without_a_load_is_doubted() -> None:
    """A body of 4000 x 1.5 / 1.3 = 4615.4 kg lifts the rear axle, first where its arm is level."""
    assert doubts(tractor(4610.0)) == ""
    # 4800 kg: (4000 x 1.5 - 4800 x 1.3) / 2.5 = -96 kg
    text = (
        "The static load of rear at alpha3 = 0 deg is -96 kg, so the tractor tips; 800 kg or more"
    )
    assert doubts(tractor(4800.0)).startswith(text)


@pytest.mark.parametrize(("height", "doubted"), [(-1.45, False), (-1.55, True)])
def test_a_wheel_on_a_tractor_is_doubted(height: float, doubted: bool) -> None:
    """The axles are at -1 m: the soil is more than 0.5 m below, and no point of the tractor."""
    content = tractor()
    content["ground"] = content["ground"] | {"W": [1.0, height]}
    [body] = content["rigid_bodies"]
    point = next(p for p in content["rigid_bodies"][body]["points"] if p not in content["ground"])
    content["springs"] = content["springs"] | {"wheel": {"between": ["W", point], "stiffness": 1e4}}
    doubts = " ".join(linkage_doubts(LinkageModel(mechanism_from_mapping(content))))
    assert ("Spring wheel ends at W" in doubts) == doubted


def test_a_table_says_which_axle_has_no_load() -> None:
    """A table has the forces at rest: their signs decide, and as they are nothing is doubted."""
    mechanism, table = read_mechanism(config_file(DEFAULT_MECHANISM)), load_table()
    assert not [*tabulated_doubts(mechanism, table)]
    [text] = tabulated_doubts(mechanism, replace(table, static_forces=-table.static_forces))
    stroke = np.linspace(*mechanism.stroke, 9).tolist()
    heaviest = max(LinkageModel(mechanism).mount_loads(angle).max() for angle in stroke)
    assert f" is -{heaviest / 9.80665:.0f} kg, so the tractor tips" in text


def test_a_table_without_forces_hides_no_doubt() -> None:
    """A tractor that rolls freely tips under 4 t as well, although its table has no forces."""
    mapping = in_plane(yaml.safe_load(config_file(DEFAULT_MECHANISM).read_text()))
    del mapping["uncertainty"]
    mapping["rigid_bodies"]["implement"]["mass"] = 4000.0
    for mount in mapping["base"]["mounts"].values():
        mount["stiffness"][0] = mount["damping"][0] = 0.0
    mechanism = mechanism_from_mapping(mapping)
    table = build_table(LinkageModel(mechanism), 1e-3)
    assert (table.free_modes, table.forces) == (1, ())
    assert any(
        "front_axle" in text and "tips" in text for text in tabulated_doubts(mechanism, table)
    )


@pytest.mark.parametrize(("centre", "tips"), [(-3.01, 1), (-2.99, 0), (-0.51, 0), (-0.49, 1)])
def test_a_tractor_that_tips_alone_is_doubted(centre: float, tips: bool) -> None:
    """Its centre of gravity lies between the axles, usually -3 + (0.35 to 0.5) x 2.5 m."""
    text = doubts(tractor(0.1, centre))
    assert (
        ("not between rear and front" in text) == ("-2.12 to -1.75 m is plausible" in text) == tips
    )
    assert bool(text) == tips


@pytest.mark.parametrize(
    ("deviations", "words"),
    [
        ({"place": 0.5, "mass_of_base": 4000.0}, ""),
        ({"place": 0.51}, "base.centre_of_gravity.0 is 0.51, and 0.01 with a tape measure"),
        ({"place": 10.0}, "base.centre_of_gravity.0 is 10, and 0.01 with a tape measure"),
        ({"mass_of_base": 4001.0}, "base.mass is 4001, and at most 4000 is plausible"),
    ],
)
def test_deviations_that_nobody_measures_are_doubted(
    deviations: dict[str, float], words: str
) -> None:
    """Places are known to half a metre by eye, and masses are not below zero."""
    text = doubts(tractor(**deviations))
    assert words in text
    assert bool(text) == bool(words)


@pytest.mark.parametrize(("deviation", "doubted"), [(44.0, False), (46.0, True)])
def test_a_direction_of_roll_near_zero_is_known_to_some_degrees(
    deviation: float, doubted: bool
) -> None:
    """A direction of -2 deg may have a larger deviation than itself, unlike a mass."""
    mapping = yaml.safe_load(config_file("three_point_linkage_on_tractor.yaml").read_text())
    mapping["lateral"]["inertia"]["implement"]["axis"] = -2.0
    mapping["uncertainty"] = {"absolute": {"lateral.inertia.implement.axis": deviation}}
    assert ("implement.axis is 46, and at most 45 is plausible" in doubts(mapping)) == doubted


@pytest.mark.parametrize(
    ("singles", "words"),
    [
        ((), ""),
        (COUNTS, ""),
        (("lower_link",), "lift_rod has count: 2, but lower_link, which shares V1 with it, is"),
        (("lift_rod", "lower_link"), "input_crank has count: 2, but lift_rod, which shares V2"),
    ],
)
def test_a_forgotten_count_is_doubted(mapping: Any, singles: tuple[str, ...], words: str) -> None:
    """Lower links, lift rods and lift arms all are pairs, or none of them is."""
    for name in singles:
        del mapping["links"][name]["count"]
    text = doubts(mapping)
    assert words in text
    assert text.count("write `count: 2`") == bool(words)


def test_a_pair_in_the_middle_is_doubted(mapping: Any) -> None:
    """Where one pair is beside the middle, all are."""
    y, cranks = {"P1": 0.2, "E1": 0.4}, {"P3": 0.25, "V2": 0.25}
    inertia = {"implement": {"roll": 550.0, "yaw": 650.0}}
    response = {"drive_point": "E1", "direction": "y", "modes": 6}
    mapping["lateral"] = {"y": y, "inertia": inertia, "response": response}
    assert doubts(mapping).count("Both of input_crank are in the middle; give the y") == 1
    mapping["lateral"]["y"] |= cranks
    assert "in the middle" not in doubts(mapping)


@pytest.fixture(scope="module")
def predictor() -> Predictor:
    """Return what predicts for the simple tractor."""
    return Predictor(build_table(LinkageModel(mechanism_from_mapping(TRACTOR)), tolerance=1e-2))


@pytest.fixture(scope="module")
def no_levels(predictor: Predictor) -> LevelTable:
    """Return levels that know no load ratio."""
    orders = excitations_from_mapping({"engine": {"speed": "engine", "orders": [1]}})
    return LevelTable(predictor, mechanism_from_mapping(TRACTOR), orders)


def about(levels: LevelTable, **changes: Any) -> str:
    """Return what is doubtful about an excitation without regard to its load ratio."""
    content = {"speed": "pto", "orders": [0.01], "at": "E.z", "at_speed": 540.0, **changes}
    if "base_displacement" not in changes and "terrain" not in changes:
        content.setdefault("force", [1.0])
    return " ".join(excitation_doubts(excitations_from_mapping({"shaft": content}), levels))


@pytest.mark.parametrize(
    ("speed", "plausible", "value", "hint"),
    [
        ("engine", (400.0, 4000.0), 209.0, "; write 1996 if it is in rad/s."),
        ("pto", (200.0, 1500.0), 16.0, "; write 960 if it is in Hz."),
        ("ground", (0.2, 20.0), 40.0, "; write 11.11 if it is in km/h."),
    ],
)
def test_a_speed_in_another_unit_is_doubted(
    no_levels: LevelTable, speed: str, plausible: tuple[float, float], value: float, hint: str
) -> None:
    """The speed of an amplitude is one that engines, shafts and tractors have."""
    wheel = {"rolling_radius": 0.8} if speed == "ground" else {}
    for end, outside in zip(plausible, (0.99, 1.01), strict=True):
        assert about(no_levels, speed=speed, at_speed=end, **wheel) == ""
        text = about(no_levels, speed=speed, at_speed=outside * end, **wheel)
        assert f"shaft has an at_speed of {outside * end:g} " in text
    assert hint in about(no_levels, speed=speed, at_speed=value, **wheel)


@pytest.mark.parametrize(
    ("radius", "words"),
    [(0.19, "0.2 to 1.2 m."), (0.2, ""), (1.2, ""), (1.21, "1.2 m; write 0.605 if it is a dia")],
)
def test_a_diameter_in_place_of_a_radius_is_doubted(
    no_levels: LevelTable, radius: float, words: str
) -> None:
    """It is doubted once for all orders, and also of the wheels on a terrain."""
    wheel: dict[str, Any] = {"speed": "ground", "rolling_radius": radius, "at_speed": 5.0}
    text = about(no_levels, **wheel, orders=[0.01, 0.02], force=[1.0, 1.0])
    assert words in text
    assert bool(text) == bool(words)
    road = {"speed": "ground", "terrain": {"class": "B"}, "raised": True, "lugs": 20}
    excitations = excitations_from_mapping({"shaft": {**road, "rolling_radius": radius}})
    on_road = " ".join(excitation_doubts(excitations, no_levels))
    assert on_road.replace(" (class B)", "") == text


def test_millimetres_of_runout_are_doubted(no_levels: LevelTable) -> None:
    """A tyre that is out of round by 1.4 m is one by 1.4 mm; 5 cm are not doubted."""
    wheel = {"speed": "ground", "rolling_radius": 0.8, "at_speed": 5.0, "at": "base:rear.z"}
    assert about(no_levels, **wheel, base_displacement=[0.05]) == ""
    assert "; write 5.1e-05 if" in about(no_levels, **wheel, base_displacement=[0.051])
    assert "; write 0.0014 if" in about(no_levels, **wheel, base_displacement=[1.4])


def test_the_excitations_of_the_shipped_tractor_have_no_doubt() -> None:
    """At the speed of its amplitude, each order loads it by less than its weight."""
    name = "three_point_linkage_on_tractor"
    orders = [e for e in read_excitations(config_file("excitations.yaml")) if e.load]
    shipped = Predictor(load_table(config_file(f"tables/{name}.npz")))
    levels = LevelTable(shipped, read_mechanism(config_file(f"{name}.yaml")), orders)
    assert levels.has_load_ratios
    assert len(orders) == 12
    assert not [*excitation_doubts(orders, levels)]


def test_the_excitations_of_the_documentation_have_no_doubt(no_levels: LevelTable) -> None:
    """All orders, wheels and grounds that a reader may copy are plausible."""
    pages = [(DOCS / page).read_text() for page in ("excitation.md", "ground.md")]
    blocks = [
        yaml.safe_load(t) for page in pages for t in re.findall(r"```yaml\n(.*?)```", page, re.S)
    ]
    described = [block for block in blocks if any("speed" in entry for entry in block.values())]
    shipped = yaml.safe_load(config_file("excitations.yaml").read_text())
    assert len(described) > 2
    for content in (shipped, *described):
        excitations = excitations_from_mapping(content)
        assert not [*excitation_doubts(excitations, no_levels)]


@pytest.mark.parametrize(("share", "doubted"), [(0.99, False), (1.01, True), (10.0, True)])
def test_a_load_beyond_the_weight_is_doubted(
    predictor: Predictor, share: float, doubted: bool
) -> None:
    """A slow force at 1 m loads the strut as the weight at 0.8 m if F / sqrt(2) = 0.8 m g."""
    limit = math.sqrt(2.0) * 0.8 * 12.0 * 9.80665  # 133 N
    shaft = {"speed": "pto", "orders": [0.01], "at": "E.z", "at_speed": 540.0}
    excitations = excitations_from_mapping({"shaft": {**shaft, "force": [share * limit]}})
    levels = LevelTable(predictor, mechanism_from_mapping(TRACTOR), excitations)
    text = " ".join(excitation_doubts(excitations, levels))
    assert bool(text) == doubted
    if doubted:
        assert text.startswith("The load ratio of shaft 0.01 at alpha3 = ")
        assert f", {share:g}, is above 1:" in text
        assert text.endswith("; an amplitude of 1.3e+02 would have 1, so check its unit.")


@pytest.mark.parametrize(
    ("mounts", "ground", "doubted"),
    [
        (0.0, None, True),
        (1.6, None, False),
        *(pytest.param(0.0, track, False, marks=pytest.mark.nightly) for track in (1.6, 0.0)),
    ],
)
def test_axles_without_a_track_are_doubted(
    mounts: float, ground: float | None, doubted: bool
) -> None:
    """The track may be given by the mounts or by the ground, where 0 is one wheel."""
    mechanism = read_mechanism(config_file("three_point_linkage_on_tractor.yaml"))
    assert mechanism.base is not None
    axles = tuple(replace(mount, track=mounts) for mount in mechanism.base.mounts)
    changed = replace(mechanism, base=replace(mechanism.base, mounts=axles))
    field = {"speed": "ground", "terrain": {"class": "A"}, "raised": True}
    content = field if ground is None else field | {"track": ground}
    excitations = excitations_from_mapping({"field": content})
    built = load_table(config_file("tables/three_point_linkage_on_tractor.npz"))
    text = " ".join(
        excitation_doubts(excitations, LevelTable(Predictor(built), changed, excitations))
    )
    assert bool(text) == doubted
    if doubted:
        assert text.startswith("field (class A) has no track")
        assert text.endswith("give each axle of the base its `track`, in m.")


@pytest.mark.parametrize(("rougher", "doubted"), [(40.0, False), (120.0, True)])
def test_a_ground_that_tyres_leave_is_doubted(rougher: float, doubted: bool) -> None:
    """At 10 km/h a tyre is off a field for less than a fifth of the time."""
    name = "three_point_linkage_on_tractor"
    [ground] = [e for e in read_excitations(config_file("excitations.yaml")) if e.terrain]
    shipped = Predictor(load_table(config_file(f"tables/{name}.npz")))
    assert ground.terrain is not None
    terrain = replace(ground.terrain, roughness=rougher * ground.terrain.roughness)
    rough = [replace(ground, terrain=terrain)]
    levels = LevelTable(shipped, read_mechanism(config_file(f"{name}.yaml")), rough)
    speed = np.array([[math.nan], [math.nan], [10.0 / 3.6]])
    share = float(levels.at_all_pairs(np.array([2.0]), speed).off_ground_share[0])
    assert (share > 0.2) == doubted
    texts = [each for each in excitation_doubts(rough, levels) if "check_chain" not in each]
    assert len(texts) == doubted
    for text in texts:
        assert text.startswith("A tyre is off the ground for 0.2")
        assert text.endswith("so check terrain and tyres.")


def test_a_load_ratio_above_1_is_doubted() -> None:
    """That of `advise` is doubted above 1, and not if it is unknown."""
    assert load_ratio_doubt(1.0, "now") == load_ratio_doubt(math.nan, "now") == ""
    assert load_ratio_doubt(1.01, "now").startswith("The load ratio now, 1.01, is above 1")


def test_commands_print_doubts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`pose` and `build` read a model, and `advise` reads levels: both say what they doubt."""
    mechanism, excitations = tmp_path / "tractor.yaml", tmp_path / "shaft.yaml"
    mechanism.write_text(yaml.safe_dump(tractor(4800.0)))
    excitations.write_text("{a: {speed: ground, rolling_radius: 1.6, orders: [1]}}")
    pose.run(Namespace(mechanism=mechanism, angles_deg=[0.0], forces=False, output=None))
    printed = capsys.readouterr().out
    assert f"{mechanism}: The static load of rear" in printed
    assert "front [kg]" in printed
    files = {"mechanism_file": str(mechanism), "excitation_file": str(excitations)}
    read_levels(with_values(Parameters(), files))
    printed = capsys.readouterr().err
    assert f"{mechanism}: The static load of rear" in printed
    assert f"{excitations}: a has a rolling_radius of 1.6 m" in printed
    files["table_file"] = str(config_file("tables/three_point_linkage_on_tractor.npz"))
    with pytest.raises(TableError, match=rf"build it again with `.*build {mechanism} -o "):
        read_levels(with_values(Parameters(), files))
