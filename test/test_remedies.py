# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a refusal of a file tells to do leads to a file that is read.

Bags of ROS have such tests of their own (`test/bags/test_wild_files.py`).
"""

import ast
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml

import linkage_vibration.bags.can_logs as can_logs
import linkage_vibration.bags.can_reader as can_reader
import linkage_vibration.bags.dbc as dbc
import linkage_vibration.listening.model_check as model_check
import linkage_vibration.listening.sensor_response as sensor_response
import linkage_vibration.listening.signals as signals
import linkage_vibration.readers.component_files as component_files
import linkage_vibration.readers.frf_faults as frf_faults
import linkage_vibration.readers.frfs as frf_files
import linkage_vibration.readers.implements as implement_files
import linkage_vibration.readers.loaded_model as loaded_model
import linkage_vibration.readers.matrices as matrix_files
import linkage_vibration.readers.mechanism as mechanism_files
import linkage_vibration.readers.profiles as profile_files
import linkage_vibration.readers.recordings as recording_files
import linkage_vibration.readers.sensors as sensor_files
import linkage_vibration.studies.measurement as measurement
import linkage_vibration.studies.ringdown as ringdown
from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.message_types import IMU
from linkage_vibration.bags.streams import open_bags
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.reduction import craig_bampton
from linkage_vibration.messages.topics import log_topic
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.targets import ModelMode
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table
from test.listening.test_model_check import MODE
from test.readers import test_frfs, test_implements, test_matrices, test_profiles
from test.studies.test_ringdown import recording

Step = Callable[[Path], object]
Content = dict[str, Any]


class Case(NamedTuple):
    """What is refused with these words, and what is read once their remedy was applied."""

    words: str
    bad: Step
    good: Step


CASES: dict[str, Case] = {}
_bad: Any
_good: Any


def add(name: str, words: str, read: Callable[[Path, Any], object], bad: Any, good: Any) -> None:
    """Add a case whose reader takes a folder and a content."""
    assert name not in CASES
    CASES[name] = Case(words, partial(read_content, read, bad), partial(read_content, read, good))


def read_content(read: Callable[[Path, Any], object], content: Any, folder: Path) -> object:
    """Read a content, or what a function returns."""
    return read(folder, content() if callable(content) else content)


# Links: matrices.


def read_npz(folder: Path, content: Content) -> object:
    """Read matrices, whose texts may be objects."""
    return matrix_files.read_matrices(test_matrices.dense_npz(folder, content))


def edited(**arrays: Any) -> Content:
    """Return sound matrices with other arrays; None removes one."""
    content = test_matrices.bar() | arrays
    return {name: array for name, array in content.items() if array is not None}


def condensed(content: Content, row: int) -> Content:
    """Reduce a row statically."""
    rest = [i for i in range(len(content["dofs"])) if i != row]
    stiffness = content["stiffness"]
    cross = stiffness[np.ix_(rest, [row])]
    return {
        "mass": content["mass"][np.ix_(rest, rest)],
        "stiffness": stiffness[np.ix_(rest, rest)] - cross @ cross.T / stiffness[row, row],
        "dofs": [content["dofs"][i] for i in rest],
    }


def massless() -> tuple[Content, int]:
    """Return matrices without the inertia of an inner row, and the row."""
    content = test_matrices.bar()
    row = content["dofs"].index("-")
    content["mass"][row] = content["mass"][:, row] = 0.0
    return content, row


def reduced() -> Content:
    """Return the matrices of a component that was reduced before it was written."""
    names = np.array(test_matrices.bar()["dofs"])
    order = np.argsort(names == "-", kind="stable")
    content = test_matrices.bar()
    mass, stiffness = (content[name][np.ix_(order, order)] for name in ("mass", "stiffness"))
    made = craig_bampton(mass, stiffness, int((names != "-").sum()), 5)
    dofs = [name for name in names if name != "-"]
    return {"mass": made.mass, "stiffness": made.stiffness, "dofs": dofs}


def held() -> Content:
    """Return matrices of a bar on a spring along z."""
    content = test_matrices.bar()
    row = content["dofs"].index("A z")
    content["stiffness"][row, row] *= 2.0
    return content


SOUND = test_matrices.bar()
DOFS = SOUND["dofs"]
MATRICES: dict[str, Any] = {
    "DoF twice": lambda c: c | {"dofs": ["B x" if i == DOFS.index("B x") else name
                                         for i, name in enumerate(c["dofs"])]},
    "DoF misspelt": lambda c: c | {"dofs": [name.replace("B q", "B z") for name in c["dofs"]]},
    "DoFs not named": lambda c: c | {"dofs": DOFS},
    "too many DoFs": lambda c: c | {"dofs": c["dofs"][:-1]},
    "no stiffness": lambda c: c | {"stiffness": SOUND["stiffness"]},
    "unknown array": lambda c: {name: c[name] for name in c if name != "Damping"},
    "unequal sizes": lambda c: c | {"stiffness": SOUND["stiffness"]},
    "not square": lambda c: c | {"mass": SOUND["mass"]},
    "complex": lambda c: c | {"stiffness": c["stiffness"].real},
    "not finite": lambda c: c | {"stiffness": SOUND["stiffness"]},
    "not symmetric": lambda c: c | {"stiffness": SOUND["stiffness"]},
    "too large": lambda c: reduced(),
    "negative stiffness": lambda c: c | {"stiffness": SOUND["stiffness"]},
    "too few digits": lambda c: c | {"stiffness": SOUND["stiffness"]},
    "negative damping": lambda c: c | {"damping": -c["damping"]},
}  # fmt: skip
for _name, _remedy in MATRICES.items():
    _spoil, _words = test_matrices.BAD[_name]
    _bad = _spoil(test_matrices.bar())
    add(f"matrices: {_name}", _words, read_npz, _bad, _remedy(_bad))
add("matrices: massless", "remove massless coord.*, or reduce them statically", read_npz,
    massless()[0], lambda: condensed(*massless()))  # fmt: skip
add("matrices: loose", "can still move when A x, A z are held; make more rows interface DoFs",
    read_npz, test_matrices.bar(free=tuple(test_matrices.ENDS[2:])), SOUND)  # fmt: skip
add("matrices: held", "resists a translation along z, .* write the matrices of the free", read_npz,
    held(), SOUND)  # fmt: skip
add("matrices: objects", "holds pickled objects, .*; save plain numbers and text", read_npz,
    edited(dofs=np.array(DOFS, object)), SOUND)  # fmt: skip
add("matrices: numbers", "entry 1 of dofs is not text; write it as 'P1 x'", read_npz,
    edited(dofs=np.arange(27)), SOUND)  # fmt: skip
add("matrices: inner", "has no interface DoF in dofs; write them as 'P1 x'", read_npz,
    edited(dofs=["-"] * 27), SOUND)  # fmt: skip
add("matrices: surrogates", "holds text that is not Unicode; write it again", read_npz,
    edited(dofs=np.frombuffer(b"\0\xd8\0\0" * 27, "<U1")), SOUND)  # fmt: skip


def read_named(name: str, folder: Path, content: bytes | None) -> object:
    """Read a file of a link with a name and a content."""
    if content is not None:
        (folder / name).write_bytes(content)
    read = frf_files.read_frfs if name.endswith("f") else matrix_files.read_matrices
    return read(folder / name)


def npz_of(folder: Path, _: object) -> object:
    """Read sound matrices."""
    return read_npz(folder, SOUND)


CASES["matrices: missing"] = Case(
    "bar.npz: does not exist; check the path",
    partial(read_content, partial(read_named, "bar.npz"), None),
    partial(read_content, npz_of, None),
)
CASES["matrices: suffix"] = Case(
    r"is not a file of matrices; give a \.npz file, written by `numpy\.savez`",
    partial(read_content, partial(read_named, "bar.mat"), b""),
    partial(read_content, npz_of, None),
)
CASES["matrices: damaged"] = Case(
    "is damaged or has another format than its name says .*; write it again",
    partial(read_content, partial(read_named, "bar.npz"), b"PK"),
    partial(read_content, npz_of, None),
)


# Links: FRFs.


def read_uff(folder: Path, sets: list[Content]) -> object:
    """Read FRFs in UFF."""
    return frf_files.read_frfs(test_frfs.uff(folder, sets), test_frfs.NODES)


def read_frf_npz(folder: Path, changes: Content) -> object:
    """Read FRFs in ``.npz``."""
    return frf_files.read_frfs(test_frfs.npz(folder, **changes))


def resampled(sets: list[Content]) -> list[Content]:
    """Return functions over the first 40 lines."""
    return [data | {"x": data["x"][:40], "data": data["data"][:40]} for data in sets]


def scaled(sets: list[Content], at: int, factor: float) -> list[Content]:
    """Return functions of which one has another gain."""
    return [data | {"data": data["data"] * factor} if k == at else data
            for k, data in enumerate(sets)]  # fmt: skip


sound = test_frfs.functions
UFF: dict[str, Callable[[list[Content]], list[Content]]] = {
    "no function": lambda sets: [*sets, *sound()],
    "DoF missing": lambda sets: [*sets, next(each for each in sound()
                                             if test_frfs.ends(each) == ["B z", "B z"])],
    "twice": lambda sets: sets[:-1],
    "unequal frequencies": resampled,
    "exp(-i omega t)": lambda sets: [each | {"data": each["data"].conj()} for each in sets],
    "one gain wrong": lambda sets: scaled(
        sets, [test_frfs.ends(each) for each in sets].index(["B x", "A x"]), 1 / 1.3),
    "one sign wrong": lambda sets: scaled(sets, 9, -1.0),
}  # fmt: skip
for _name, (_make, _words) in test_frfs.BAD_UFF.items():
    _repair = UFF.get(_name, lambda sets: sound())  # exported once more, as the sentence tells
    add(f"UFF: {_name}", _words, read_uff, _make(), _repair(_make()))
FREQUENCIES, OMEGA = test_frfs.FREQUENCIES[1:], test_frfs.OMEGA
RECEPTANCE = test_frfs.receptance(FREQUENCIES)
NPZ: dict[str, Content] = {
    "not finite": {name: np.delete(array, 3, axis=0)
                   for name, array in (("frequencies", FREQUENCIES), ("frf", RECEPTANCE))},
    "millimetres": {"frf": 1e-3 * (1e3 * RECEPTANCE)},
    "accelerance": {"frf": (-(OMEGA**2) * RECEPTANCE) / -(OMEGA**2)},
    "mobility": {"frf": (1j * OMEGA * RECEPTANCE) / (1j * OMEGA)},
}  # fmt: skip
for _name, (_changes, _words) in test_frfs.BAD_NPZ.items():
    add(f"FRFs: {_name}", _words, read_frf_npz, _changes, NPZ.get(_name, {}))
ZERO = RECEPTANCE.copy()
ZERO[:, 1, 1] = 0.0
TEXT = np.array([f"{hertz}" for hertz in FREQUENCIES])
add("FRFs: zero", "the FRF of response A z .* is zero; measure it again", read_frf_npz,
    {"frf": ZERO}, {})  # fmt: skip
add("FRFs: text", "has frequencies that are not a list of real numbers; give them in Hz",
    read_frf_npz, {"frequencies": TEXT}, {"frequencies": TEXT.astype(float)})  # fmt: skip
add("FRFs: sensor", "the drive point B z gives out power, .*; change the sign of the sensor",
    read_frf_npz, {"frf": RECEPTANCE * np.array([1, 1, 1, 1, -1])[:, np.newaxis]}, {})  # fmt: skip
CASES["FRFs: suffix"] = Case(
    r"is not a file of FRFs; give a \.npz, \.uff or \.unv file",
    lambda folder: frf_files.read_frfs(folder / "bar.csv"),
    lambda folder: read_frf_npz(folder, {}),
)
CASES["UFF: start"] = Case(
    "does not begin like a Universal File; export it again",
    partial(read_content, partial(read_named, "bar.uff"), b"text"),
    lambda folder: read_uff(folder, sound()),
)


def weighed(folder: Path, mass: float) -> object:
    """Read the FRFs of a bar with its points and a mass."""
    points = {"A": (0.0, 0.0), "B": (0.8, 0.0)}
    frfs = test_frfs.receptance(FREQUENCIES[:10] / 10.0)
    path = test_frfs.npz(folder, frf=frfs, frequencies=FREQUENCIES[:10] / 10.0)
    return frf_files.read_frfs(path, points=points, mass=mass)


add("FRFs: mass", "the FRFs show a mass of .* that `mass` gives; .* or correct `mass`", weighed,
    20.0, 0.8 * 0.03 * 0.05 * 7800.0)  # fmt: skip


# Recordings and profiles.


def read_csv(folder: Path, content: str | bytes | None) -> object:
    """Read a recording."""
    path = folder / "a.csv"
    if content is not None:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    return recording_files.read_recording(path)


GOOD_CSV = "time,x\n0.0,1.0\n0.1,2.0\n"
for _bad, _good, _words in (
    ("time,x\n", GOOD_CSV, "has no line of numbers; give the time or distance"),
    ("t,x\n0,1\n0.1,abc\n1,1\n", "t,x\n0,1\n1,1\n", "line 3 is no line of num.*; correct or dele"),
    ("t,x\n0,1\n0.1", "t,x\n0,1\n", "line 3 has 1 columns, and those before it 2; .* or delete it"),
    ("time\n1.0\n", "time,x\n1.0,2.0\n", "has 1 columns; give the time and a channel"),
    ("t,x\n0,1\n9,1\n0,1\n", "t,x\n0,1\n9,1\n", "the times go back by 9 s; give one recording"),
    (GOOD_CSV.encode("utf-16"), GOOD_CSV, "is not text in UTF-8; save it as CSV UTF-8"),
    (None, GOOD_CSV, "cannot be read .*; give a CSV file"),
):
    add(f"recording: {_words[:30]}", _words, read_csv, _bad, _good)


def imu_bag(topics: tuple[str, ...], topic: str | None, folder: Path) -> object:
    """Read a topic of a bag of IMUs."""
    path = folder / f"{len(topics)}.mcap"
    if not path.exists():
        with LogWriter(path, [log_topic(each, IMU) for each in topics]):
            pass
    return recording_files.read_recording(path, topic)


CASES["recording: two topics"] = Case(
    "has 2 topics of type .*; choose one with --topic: /a, /b",
    partial(imu_bag, ("/a", "/b"), None), partial(imu_bag, ("/a", "/b"), "/a"),
)  # fmt: skip
CASES["recording: no such topic"] = Case(
    "has no /c of type .*; it has topics: /a, /b",
    partial(imu_bag, ("/a", "/b"), "/c"), partial(imu_bag, ("/a", "/b"), "/b"),
)  # fmt: skip
CASES["recording: no topic"] = Case(
    "has 0 topics of type .*; record an IMU", partial(imu_bag, (), None),
    partial(imu_bag, ("/a",), None),
)  # fmt: skip


def read_profile(folder: Path, columns: tuple[Any, ...]) -> object:
    """Read a profile."""
    return profile_files.read_profile(test_profiles.write(folder / "road.csv", *columns))


for _name, (_columns, _words) in test_profiles.FAULTS.items():
    add(f"profile: {_name}", _words, read_profile, _columns,
        (test_profiles.DISTANCE, test_profiles.HEIGHT))  # fmt: skip
CASES["profile: missing"] = Case(
    "cannot be read .*; give a CSV file",
    lambda folder: profile_files.read_profile(folder / "none.csv"),
    lambda folder: read_profile(folder, (test_profiles.DISTANCE, test_profiles.HEIGHT)),
)


# Sensors.


def read_sensors(folder: Path, text: str) -> object:
    """Read the description of a sensor."""
    path = folder / "sensors.yaml"
    path.write_text(f"imu: {{{text}}}" if text else "{}")
    return sensor_files.read_sensors(path)


HEAD = "unit: g, at: E1, topic: /a"
for _bad, _good, _words in (
    ("", HEAD, "there is no sensor; describe at least one by its name"),
    ("topic: /a, unit: g", HEAD, "imu.at: this key is missing"),
    (f"{HEAD}, axes: [x, y]", f"{HEAD}, axes: [-x, -y, z]", r"say where .* as .* \[-x, -y, z\]"),
    (f"{HEAD}, fields: [a]", f"{HEAD}, fields: [a, b, c]", "1 are given; give three, along"),
    ("file: a.csv, unit: g, at: E1, columns: [2, 2, 3]",
     "file: a.csv, unit: g, at: E1, columns: [2, 3, 4]", "give different whole numbers from 2"),
):  # fmt: skip
    add(f"sensors: {_words[:30]}", _words, read_sensors, _bad, _good)


def read_live(folder: Path, text: str) -> object:
    """Read the description of a sensor that the node compares."""
    path = folder / "sensors.yaml"
    path.write_text(f"imu: {{{text}}}")
    return sensor_files.live_sensors(path)


add("sensors: live", "imu is in a CSV file, .*; give its topic", read_live,
    "file: a.csv, unit: g, at: E1", HEAD)  # fmt: skip


def read_measured(folder: Path, text: str) -> object:
    """Read what a sensor measured: a CSV file, or a log with a force."""
    (folder / "a.csv").write_text("0,1,2,3,,,\n1,1,2,3,,,\n")
    float64 = log_topic("/a", "std_msgs/msg/Float64")
    log = folder / "log.mcap"
    if not log.exists():
        with LogWriter(log, [float64, log_topic("/none", "std_msgs/msg/Float64")]) as writer:
            writer.write("/a", b"\0\1\0\0" + bytes(8), 10**9, 10**9)
    path = folder / "sensors.yaml"
    path.write_text(f"imu: {{{text}}}")
    [sensor] = sensor_files.read_sensors(path)
    return sensor_files.read_measured(sensor, log, 0)


CSV, FORCE = "file: a.csv, unit: g, at: E1", "unit: N, quantity: force, at: a"
GOOD_FORCE = f"{FORCE}, topic: /a, fields: [data]"
for _bad, _good, _words in (
    (f"{CSV}, columns: [7, 8, 9]", CSV, "imu needs column 9, and it has 7; correct columns"),
    (f"{CSV}, columns: [5, 6, 7]", CSV, "no line has numbers in .*; correct columns, or the file"),
    (f"{FORCE}, topic: /b, fields: [data]", GOOD_FORCE, "has no topic /b for imu; it has /a"),
    (f"{FORCE}, topic: /none, fields: [data]", GOOD_FORCE, "has no reading for imu; record more"),
    ("unit: g, at: E1, topic: /a", "unit: g, at: E1, topic: /a, fields: [data, data, data]",
     "name the three fields of std_msgs/msg/Float64 under fields"),
    (f"{FORCE}, topic: /a, fields: [x]", GOOD_FORCE, "has no number 'x'; its numbers are data"),
):  # fmt: skip
    add(f"measured: {_words[:30]}", _words, read_measured, _bad, _good)


# Mechanisms and implements.

MECHANISM = config_file("three_point_linkage.yaml").read_text()


def read_mechanism(folder: Path, text: str | bytes | None) -> object:
    """Read a mechanism."""
    path = folder / "m.yaml"
    if text is not None:
        path.write_bytes(text.encode() if isinstance(text, str) else text)
    return mechanism_files.read_mechanism(path)


MASS = f"mass: {yaml.safe_load(MECHANISM)['rigid_bodies']['implement']['mass']:g}"
assert MASS in MECHANISM
for _bad, _words in (
    (None, "cannot be opened: No such file.*; give the path of a YAML file"),
    (MECHANISM.encode("utf-16"), "is not text in UTF-8; give a YAML file"),
    (f"{MECHANISM}a: [", r"is not valid YAML: line \d+"),
    (f"{MECHANISM}a: !!timestamp x\n", r"is not valid YAML \(.*\); fix that value"),
    (f"{MECHANISM}links: 1\n", "the key 'links' occurs twice; remove one"),
    (f"{MECHANISM}a: {{b: 0,85}}\n", r"line \d+: .* write 0\.85 with a decimal point"),
    (f"{MECHANISM}a: 1{400 * '0'}\n", "the number is too large"),
    (MECHANISM.replace(MASS, "mass: -1"), r"m\.yaml: rigid_bodies\.implement\.mass: -1 is not"),
    (MECHANISM.replace("diameter: 0.029", "diameter: 1.0e-300"), "compute with; check the units"),
):
    add(f"mechanism: {_words[:40]}", _words, read_mechanism, _bad, MECHANISM)
CASES["mechanism: path"] = Case(
    "is not a path; give the path of a YAML file",
    lambda folder: mechanism_files.read_mechanism(folder / "a\0"),
    lambda folder: read_mechanism(folder, MECHANISM),
)


def with_matrices(folder: Path, content: Content | None) -> object:
    """Read a mechanism with a link of matrices of the default linkage."""
    mapping = yaml.safe_load(MECHANISM)
    model = LinkageModel(mechanism_files.read_mechanism())
    made: Any = next(each for each in model.components if each.name == "lower_link")
    count = next(each.count for each in model.mechanism.links if each.name == "lower_link")
    arrays = {"mass": made.mass / count, "stiffness": made.stiffness / count,
              "dofs": [str(dof) for dof in made.dofs]}  # fmt: skip
    keys = mapping["links"]["lower_link"]
    for key in ("section", "sections", "material", "elements"):
        keys.pop(key, None)
    keys["file"] = {"kind": "matrices", "path": "bar.npz"}
    test_matrices.dense_npz(folder, arrays if content is None else arrays | content)
    return read_mechanism(folder, yaml.safe_dump(mapping, sort_keys=False))


add("mechanism: link", r"lower_link\.file: .*mass is not of numbers; write real", with_matrices,
    {"mass": "x"}, None)  # fmt: skip


def read_implements(folder: Path, implements: Any) -> object:
    """Read implements."""
    path = test_implements.written(folder, implements)
    return implement_files.read_implements(path, mechanism_files.read_mechanism())


PLOUGH = test_implements.PLOUGH
for _bad, _words in (
    ({" x": PLOUGH}, "' x' has spaces around it"),
    ({}, "names no implement; add one"),
    ({"x": PLOUGH | {"mass": -1.0}}, "mass: -1 is not greater than"),
    ({"x": PLOUGH | {"rigid_body": "boom"}}, "There is no rigid body .* name one of: implement"),
):
    add(f"implements: {_words}", _words, read_implements, _bad,
        {"x": PLOUGH | {"rigid_body": "implement"}})  # fmt: skip


def another_implement(_: Path, numbers: dict[str, float]) -> object:
    """Replace the implement of the shipped hitch by another one."""
    path = config_file("three_point_linkage_on_tractor.yaml")
    described = loaded_model.read_described(Parameters(mechanism_file=str(path)))
    return loaded_model.with_other_body(described, path, **numbers)


for _bad, _good in ((200.0, 313.0), (4000.0, 3749.0)):  # 650 - 550 to 650 + 550 kg m2, for 800 kg
    add(f"implements: {_bad} kg m2", "pitch cannot be .*; give one of 312.5 to 3750 with it",
        another_implement, {"mass": 2500.0, "inertia": _bad}, {"mass": 2500.0, "inertia": _good}
        )  # fmt: skip


# Listening.

RATE, STEPS = 200.0, np.arange(2000)


def listen(folder: Path, times: Any) -> object:
    """Return the signal of a sensor with these times."""
    readings = np.tile([0.0, 0.0, 9.81], (len(times), 1))
    readings[:, 2] += np.sin(0.7 * np.arange(len(times)))
    return signals.measured_signal(sensor(), times, readings, 20.0)


def sensor(at: str = "E1") -> sensor_files.Sensor:
    """Return an accelerometer at a place."""
    return sensor_files.Sensor(
        "imu", at, True, 1.0, np.eye(3), math.inf, None, "/a", IMU, (), (), 0.0, False
    )


ARRIVED = np.cumsum(np.random.default_rng(1).uniform(0.01, 0.09, 500))
BURSTS = np.add.outer(ARRIVED, np.arange(10) * 1e-9).ravel()
LATE = STEPS / RATE + 0.02 * np.random.default_rng(1).random(2000)
for _bad, _good, _words in (
    (STEPS[:15] / RATE, STEPS[:16] / RATE, "has 15 samples; record at least 16"),
    (5.0 * STEPS, 5.0 * STEPS / 1000.0, "samples per second, too few .*, and give its times in s"),
    (BURSTS, np.arange(5000) / RATE, "come in bursts; stamp each sample when it is taken"),
    (ARRIVED.repeat(10), np.arange(5000) / RATE, "4500 of 5000 .* each sample with a time of its"),
    (np.sort(LATE), STEPS / RATE, "vary by more than a step; stamp each sample when it is taken"),
):
    add(f"listen: {_words[:40]}", _words, listen, _bad, _good)


def respond(folder: Path, at: str) -> object:
    """Return the response of a sensor at a place."""
    mechanism = mechanism_files.read_mechanism()
    return sensor_response.SensorResponse(load_table(), mechanism, (), sensor(at))


add("listen: place", "has no response at P9, .*; name one of .*E1", respond, "P9", "E1")


def targets(folder: Path, doubt: str) -> object:
    """Return a calibration to a mode of a drive."""
    table, path = load_table(), folder / "fit.yaml"
    return model_check.drive_targets([replace(MODE, doubt=doubt)], table,
                                     config_file("three_point_linkage.yaml"), path)  # fmt: skip


add("listen: targets", "no mode of the drive is without doubt.*; drive longer", targets,
    "a reason", "")  # fmt: skip


# Measuring.


def compare(folder: Path, angle_deg: float) -> object:
    """Compare a mode that was measured at an angle."""
    mode = ringdown.MeasuredMode(3.0, 0.01, 0.1, 0.1, 5)
    model = LinkageModel(mechanism_files.read_mechanism())
    return measurement.compare(model, math.radians(angle_deg), [mode])


def fit(folder: Path, mode: ModelMode | None) -> object:
    """Return a calibration to a measured mode that belongs to one of the model."""
    measured = ringdown.MeasuredMode(7.5, 0.02, 0.1, 0.001, 5)
    pair = measurement.ComparedMode(2.0, measured, mode, 7.4, 0.01)
    path = config_file("three_point_linkage.yaml")
    return measurement.calibration_text([pair], path, folder / "fit.yaml")


add("measure: angle", "2 deg is outside the stroke .*; give alpha3 in degrees", compare,
    2.0, math.degrees(2.0))  # fmt: skip
add("measure: word", r"write ANGLE:FILE, such as 112\.5:low\.csv",
    lambda folder, word: measurement.angle_and_path(word), "low.csv", "112.5:low.csv")  # fmt: skip
add("measure: modes", "is within a factor of 1.5 of one mode alone; check the angles, and",
    fit, None, ModelMode("vertical", 2))  # fmt: skip


def measure(folder: Path, blows: tuple[Any, Any]) -> object:
    """Find modes in a recording of blows."""
    return ringdown.measure_modes(*blows)


BLOWS = recording(np.random.default_rng(3))
for _bad, _words in (
    (recording(np.random.default_rng(2), blows=0, seconds=8.0), "No blow stands .*; hit harder"),
    ((BLOWS[0][:5], BLOWS[1][:5]), "has 5 samples; give 40 or more"),
    (
        (np.add.outer(0.1 * STEPS, STEPS[:10] / 1000.0).ravel(), np.ones((20000, 1))),
        "come in bursts; stamp each sample when it is taken",
    ),
    ((1000.0 * BLOWS[0], BLOWS[1]), "too few for a blow; give times in seconds"),
    ((np.where(BLOWS[0] < 11.5, BLOWS[0], BLOWS[0] + 9.0), BLOWS[1]), "give one without pauses"),
    ((BLOWS[0], np.clip(BLOWS[1], -0.5, 0.5)), "Channel 1 .*; hit softer, or set a larger"),
):
    add(f"measure: {_words[:30]}", _words, measure, _bad, BLOWS)


# Logs of a CAN bus, and the files that describe their frames.

FRAMES = [f"(1700000000.{k:06d}) can0 123#1122\n" for k in range(10)]
HEX = ("***BUSMASTER***\n***HEX***\n***SYSTEM MODE***\n"
       "***START DATE AND TIME 14:11:2023 10:13:20***\n"
       "10:13:20:5000 Rx 1 0x123 s 2 11 22\n")  # fmt: skip
ASC = "date Tue Nov 14 10:13:20.500 pm 2023\nbase hex  timestamps absolute\n"
FRAME = "   0.250000 1  7FFx  Rx d 1 7E\n"


def read_log(folder: Path, log: tuple[str, str]) -> object:
    """Read a log by its name and its text."""
    path = folder / log[0]
    path.write_text(log[1])
    with open_bags([path]) as bags:
        assert sum(len(block) for block in bags.blocks([each.name for each in bags.topics])) > 0
        return bags


for _name, _bad, _good, _words in (
    ("a.log", "x\n" + 2 * "y\n" + FRAMES[0], FRAMES[0], "has 3 lines .* correct or delete them"),
    ("a.asc", ASC, ASC + FRAME, "has no frames that can be read: none was received, or the file"),
    ("a.asc", ASC.replace("absolute", "relative") + FRAME, ASC + FRAME, "with absolute times"),
    ("a.log", "".join(f"(0.0{k % 2}0000) can0 123#11\n" for k in range(10)), "".join(FRAMES),
     "has differences of times instead of times; record it with `candump -l`"),
    ("a.log", "".join(FRAMES) + "".join(each.replace("(17", "(16") for each in FRAMES),
     "".join(FRAMES), "goes back in time by .* at frame 11, .*; split the log there"),
    ("a.log", "".join(each.replace("can0", f"c{k}") for k in range(7) for each in FRAMES[:1])
     + "".join(f"(1700000000.1) d{k} 123#11\n" for k in range(60)), "".join(FRAMES),
     "has more than 64 channels; give a log of fewer"),
    ("a.log", HEX.replace("HEX", "DEC"), HEX, r"save it with `\*\*\*HEX"),
    ("a.mf4", "text", None, "does not begin like an MF4 file; give another file"),
):  # fmt: skip
    add(f"CAN: {_words[:35]}", _words, read_log, (_name, _bad),
        (_name, _good) if _good else ("a.log", FRAMES[0]))  # fmt: skip


def read_blf(folder: Path, start: float) -> object:
    """Read a log in BLF that begins at a time, s."""
    can = pytest.importorskip("can")
    with can.BLFWriter(folder / "a.blf") as log:
        log(can.Message(start, 0x123, data=b"1"))
    with open_bags([folder / "a.blf"]) as bags:
        return bags


add("CAN: time", "a time before 1970 or after 2038; set the clock, and record again", read_blf,
    2.3e9, 1.7e9)  # fmt: skip
DBC = 'VERSION ""\nBU_: A\nBO_ 291 M: 8 A\n SG_ S : 0|16@1+ (1,0) [0|0] "" A\n'
LONG = DBC.replace("291 M: 8", "2566844926 M: 9")


def read_signal(folder: Path, about: tuple[str | None, str]) -> object:
    """Read a signal of a DBC file."""
    text, name = about
    path = folder / "a.dbc"
    if text is not None:
        path.write_text(text)
    return can_reader.find_signal(name, str(path))


for _bad, _good, _words in (
    ((DBC, "S"), (DBC, "M.S"), "'S' is not the name of a signal; write MESSAGE.SIGNAL"),
    ((None, "M.S"), (DBC, "M.S"), "cannot be opened: .*; check the path"),
    (("BO_", "M.S"), (DBC, "M.S"), r"is not a valid DBC file \(.*\); correct it"),
    ((DBC, "M.X"), (DBC, "M.S"), "has no signal of M X; choose for example S"),
    ((DBC + DBC[DBC.index("BO_") :].replace("291", "292"), "M.S"), (DBC, "M.S"),
     "has message M 2 times; .* or keep one"),
    ((DBC.replace("0|16", "56|16"), "M.S"), (DBC, "M.S"), "into byte 9, .*; correct the file"),
    ((LONG, "M.S"), (LONG + DBC[DBC.index("BO_") :].replace("M", "N"), "N.S"),
     "has 9 bytes, which J1939 .*; choose a signal of a message with at most 8 bytes"),
    ((DBC, "engine_speed@254"), (DBC, "engine_speed@253"), "write one from 0 to 253, such as"),
    ((DBC, "M.S@0"), (DBC, "M.S"), "write M.S without an address"),
):  # fmt: skip
    add(f"signal: {_words[:30]}", _words, read_signal, _bad, _good)
CASES["signal: unknown"] = Case(
    "There is no CAN signal 'x'; choose one of rear_hitch_position, .*, or name a DBC file",
    lambda folder: can_reader.find_signal("x", ""),
    lambda folder: can_reader.find_signal("rear_hitch_position", ""),
)


@pytest.mark.parametrize("name", CASES)
def test_remedy(tmp_path: Path, name: str) -> None:
    """A sentence says what to do, and once that is done, the same reader accepts the file."""
    case = CASES[name]
    with pytest.raises(LinkageVibrationError, match=case.words) as caught:
        case.bad(tmp_path)
    assert "\n" not in str(caught.value)
    assert case.good(tmp_path) is not None


# Where no content of a file leads, or another test applies the remedy, by a part of the line.
ELSEWHERE = {
    # One bad line; test_joined_blf.
    can_logs: ["needs asammdf", "StopIteration", "raise ValueError(", "holds another log"],
    component_files: ["cannot be opened: {error.strerror}", "reduce the component before"],
    frf_files: ["has no numbers that can be read", "lines instead of"],
}
MODULES: list[ModuleType] = [
    can_logs,
    can_reader,
    dbc,
    component_files, frf_faults, frf_files, implement_files, matrix_files, mechanism_files,
    profile_files, recording_files, sensor_files, signals, sensor_response, model_check,
    measurement, ringdown,
]  # fmt: skip


def raised_lines(error: BaseException | None) -> Iterator[tuple[str, int]]:
    """Yield the file and the line of each raise of an error, and of those behind it."""
    while error is not None:
        trace = error.__traceback__
        while trace is not None:
            yield trace.tb_frame.f_code.co_filename, trace.tb_lineno
            trace = trace.tb_next
        error = error.__context__


def test_every_refusal_has_a_case(tmp_path: Path) -> None:
    """Each sentence of a reader, of listening and of measuring is in one of the cases."""
    reached: set[tuple[str, int]] = set()
    for k, case in enumerate(CASES.values()):
        (folder := tmp_path / str(k)).mkdir()
        try:
            case.bad(folder)
        except LinkageVibrationError as error:
            reached |= {*raised_lines(error)}
    missing = []
    for module in MODULES:
        path = Path(str(module.__file__))
        source = path.read_text()
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Raise) and node.exc is not None:
                text = ast.get_source_segment(source, node) or ""
                lines = {(str(path), n) for n in range(node.lineno, (node.end_lineno or 0) + 1)}
                if not lines & reached and not any(e in text for e in ELSEWHERE.get(module, [])):
                    missing.append(f"{path.name}:{node.lineno}: {text}")
    assert missing == []
