# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Every reader of files, with small files that it accepts and a check of what it returns."""

import io
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from linkage_vibration.bags.field_reader import FieldReader
from linkage_vibration.bags.message_types import JOINT_STATE
from linkage_vibration.bags.scalar_reader import SkippedMessages
from linkage_vibration.bags.streams import open_bags
from linkage_vibration.mechanics.bodies.frfs import Frfs
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.playback.remapping import topic_schema
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.frfs import read_frfs
from linkage_vibration.readers.matrices import read_matrices
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.studies.calibration import read_calibration
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table, table_bytes
from linkage_vibration.table.tabulation import build_table

FloatArray = NDArray[np.float64]
Files = dict[str, bytes]
Seeds = tuple[tuple[str, Files], ...]

_NODES = {1: "A", 2: "B"}


@dataclass(frozen=True)
class Reader:
    """A reader of files: how a report calls it, what makes its seeds, and what reads a path.

    The last raises an AssertionError if the result is invalid.
    """

    name: str
    make: Callable[[], Seeds]
    read: Callable[[Path], None]

    @cached_property
    def seeds(self) -> Seeds:
        """Inputs that it accepts: the path to read, and the contents of all files by name."""
        return self.make()


def all_readers() -> tuple[Reader, ...]:
    """Return every reader."""
    return (
        Reader("mechanism (YAML)", _mechanisms, _read_mechanism),
        Reader("calibration (YAML)", _calibrations, _read_calibration),
        Reader("excitations (YAML)", _excitations, _read_excitations),
        Reader("table (npz)", _tables, _read_table),
        Reader("matrices (npz)", _matrices_npz, _read_matrices),
        Reader("FRFs (npz)", _frfs_npz, _read_frfs),
        Reader("FRFs (UFF 58)", _frfs_uff, _read_frfs),
        Reader("bag (MCAP)", _bags_mcap, _read_bag),
        Reader("bag (db3)", _bags_db3, _read_bag),
        Reader("bag (ROS 1)", _bags_ros1, _read_bag),
    )


def _alone(name: str, *contents: bytes) -> Seeds:
    return tuple((name, {name: content}) for content in contents)


def _read_mechanism(path: Path) -> None:
    mechanism = read_mechanism(path)
    assert len(mechanism.model_hash) == 64
    assert 3 * len(mechanism.bodies) - 2 * len(mechanism.joints) == 1


def _read_calibration(path: Path) -> None:
    calibration = read_calibration(path)
    assert all(0.0 < p.low < p.high < math.inf for p in calibration.parameters)


def _read_excitations(path: Path) -> None:
    excitations = read_excitations(path)
    assert excitations
    assert all(each.terrain or 0.0 < each.ratio < math.inf for each in excitations)


def _read_table(path: Path) -> None:
    """Read a table; it must equal the one that was written."""
    assert table_bytes(load_table(path)) == _tables()[0][1]["t.npz"]


def _read_matrices(path: Path) -> None:
    body = read_matrices(path)
    for matrix in (body.mass, body.stiffness, body.damping):
        if matrix is not None:
            assert matrix.dtype == np.float64
            assert matrix.shape == body.mass.shape
            assert np.isfinite(matrix).all()
            assert (matrix == matrix.T).all()
    assert len(body.dofs) == len(set(body.dofs)) <= len(body.mass)


def _read_frfs(path: Path) -> None:
    body: Frfs = read_frfs(path, nodes=_NODES)
    assert body.frf.shape == (len(body.frequencies), len(body.dofs), len(body.dofs))
    assert np.isfinite(body.frf).all()
    assert (np.diff(body.frequencies) > 0.0).all()


def _read_bag(path: Path) -> None:
    with open_bags([path]) as bags:
        for topic in bags.topics:
            if topic.type == JOINT_STATE:
                schema = topic_schema(bags, topic)
                reader = FieldReader(schema, JOINT_STATE, "position[0]")
                for block in bags.blocks([topic.name]):
                    assert (np.diff(block.log_times) >= 0).all()
                    for numbers in reader.read(block, np.arange(len(block)), SkippedMessages()):
                        assert numbers.value.shape == numbers.sec.shape == numbers.rows.shape
                        assert isinstance(numbers.frame_id, str)


def _mechanisms() -> Seeds:
    names = ("four_bar", "stephenson_six_bar", "three_point_linkage")
    shipped = [config_file(f"{name}.yaml").read_bytes() for name in names]
    from_file = shipped[0].decode()
    before, rest = from_file.split("  coupler:\n", 1)
    after = rest[rest.index("  rocker:") :]
    link = "  coupler:\n    points: {B: 0.0, C: 0.45}\n    file: {kind: matrices, path: a.npz}\n"
    files = {"m.yaml": (before + link + after).encode(), **_matrices_npz()[0][1]}
    return (*_alone("m.yaml", *shipped), ("m.yaml", files))


def _calibrations() -> Seeds:
    return _with_mechanism(config_file("calibrations/paper.yaml"))


def _with_mechanism(path: Path) -> Seeds:
    """Return a file and the mechanism that it names."""
    content = path.read_bytes().replace(b"../", b"")
    mechanism = config_file("three_point_linkage.yaml")
    return ((path.name, {path.name: content, mechanism.name: mechanism.read_bytes()}),)


def _excitations() -> Seeds:
    return _alone("excitations.yaml", config_file("excitations.yaml").read_bytes())


@cache
def _tables() -> Seeds:
    mechanism = replace(read_mechanism(config_file("four_bar.yaml")), stroke=(1.0, 1.2))
    table = build_table(LinkageModel(mechanism), tolerance=0.1, points=["C"])
    return _alone("t.npz", table_bytes(table))


def _chain() -> dict[str, FloatArray]:
    """Return the matrices of three masses on a line, joined by springs; the last is internal."""
    spring = np.array([[1.0, 0.0, -1.0], [0.0, 1.0, -1.0], [-1.0, -1.0, 2.0]])
    return {"mass": np.diag([2.0, 2.0, 1.0]), "stiffness": 1e7 * spring, "damping": 30.0 * spring}


def _saved_npz(**arrays: Any) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def _matrices_npz() -> Seeds:
    return _alone("a.npz", _saved_npz(dofs=np.array(["A x", "B x"]), **_chain()))


def _receptance(frequencies: FloatArray) -> NDArray[np.complex128]:
    """Return the receptance of the chain between its ends."""
    omega = 2.0 * np.pi * frequencies[:, None, None]
    m, k, c = (_chain()[name] for name in ("mass", "stiffness", "damping"))
    return np.asarray(np.linalg.inv(k - omega**2 * m + 1j * omega * c)[:, :2, :2])


def _frfs_npz() -> Seeds:
    f = np.linspace(10.0, 800.0, 8)
    dofs = np.array(["A x", "B x"])
    return _alone("a.npz", _saved_npz(frequencies=f, frf=_receptance(f), dofs=dofs))


def _frfs_uff() -> Seeds:
    import pyuff

    f = np.linspace(100.0, 800.0, 8)
    frf = _receptance(f)
    system: dict[str, Any] = {"type": 164, "units_code": 1, "units_description": "SI"}
    system |= {"temp_mode": 1, "length": 1.0, "force": 1.0, "temp": 1.0, "temp_offset": 273.15}
    contents = []
    for spacing, binary, quantity, power in ((1, 0, 8, 0), (0, 0, 12, 2), (1, 1, 8, 0)):
        sets: list[dict[str, Any]] = [system]
        for i, j in ((0, 0), (1, 0), (1, 1)):
            ends = {"rsp_node": i + 1, "rsp_dir": 1, "ref_node": j + 1, "ref_dir": 1}
            values = {"x": f, "data": (2j * np.pi * f) ** power * frf[:, i, j]}
            kinds = {"type": 58, "func_type": 4, "binary": binary, "abscissa_spacing": spacing}
            kinds |= {"abscissa_spec_data_type": 18, "abscissa_axis_units_lab": "Hz"}  # type: ignore[dict-item]
            kinds |= {"ordinate_spec_data_type": quantity, "orddenom_spec_data_type": 13}
            sets.append({**kinds, **ends, **values})
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "a.uff"
            for data_set in sets:
                pyuff.UFF(str(path)).write_sets(data_set, "add")
            contents.append(path.read_bytes())
    return _alone("a.uff", *contents)


def _joint_states(store: Any) -> list[Any]:
    """Return two joint states of two joints."""
    header = store.types["std_msgs/msg/Header"]
    stamp = store.types["builtin_interfaces/msg/Time"]
    sequence = {"seq": 0} if "seq" in header.__dataclass_fields__ else {}
    return [
        store.types[JOINT_STATE](
            header=header(stamp=stamp(sec=100 + k, nanosec=250), frame_id="base", **sequence),
            name=["a", "b"],
            position=np.array([k + 0.5, -1.0]),
            velocity=np.array([]),
            effort=np.array([np.nan, 3.0]),
        )
        for k in range(2)
    ]


def _bags_mcap() -> Seeds:
    store = get_typestore(Stores.ROS2_HUMBLE)
    definition = store.generate_msgdef(JOINT_STATE, ros_version=2)[0].encode()
    contents = []
    for compression, chunked in (
        (CompressionType.NONE, True),
        (CompressionType.NONE, False),
        (CompressionType.ZSTD, True),
        (CompressionType.LZ4, True),
    ):
        stream = io.BytesIO()
        writer = Writer(stream, compression=compression, use_chunking=chunked, enable_crcs=chunked)
        writer.start(profile="ros2", library="")
        schema = writer.register_schema(JOINT_STATE, "ros2msg", definition)
        channel = writer.register_channel("/joints", "cdr", schema)
        for k, message in enumerate(_joint_states(store)):
            writer.add_message(channel, k, bytes(store.serialize_cdr(message, JOINT_STATE)), k)
        writer.finish()  # type: ignore[no-untyped-call]
        contents.append(stream.getvalue())
    folder = _recorded(StoragePlugin.MCAP)
    return (*_alone("a.mcap", *contents), (".", folder))


def _bags_db3() -> Seeds:
    folder = _recorded(StoragePlugin.SQLITE3)
    return (("bag.db3", {"bag.db3": folder["bag.db3"]}), (".", folder))


def _recorded(plugin: StoragePlugin) -> Files:
    """Return the files of a bag folder."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bag"
        with Writer2(path, version=9, storage_plugin=plugin) as bag:
            connection = bag.add_connection("/joints", JOINT_STATE, typestore=store)
            for k, message in enumerate(_joint_states(store)):
                bag.write(connection, k, store.serialize_cdr(message, JOINT_STATE))
        return {file.name: file.read_bytes() for file in path.iterdir()}


def _bags_ros1() -> Seeds:
    store = get_typestore(Stores.ROS1_NOETIC)
    contents = []
    for packed in (None, Writer1.CompressionFormat.BZ2, Writer1.CompressionFormat.LZ4):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "a.bag"
            writer = Writer1(path)
            if packed is not None:
                writer.set_compression(packed)
            with writer:
                connection = writer.add_connection("/joints", JOINT_STATE, typestore=store)
                for k, message in enumerate(_joint_states(store)):
                    writer.write(connection, k, store.serialize_ros1(message, JOINT_STATE))
            contents.append(path.read_bytes())
    return _alone("a.bag", *contents)
