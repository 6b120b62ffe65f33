# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What is kept of levels is what would be computed, and a file that is not right is not used."""

import errno
import math
import os
import pickle
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction import level_cache as cache_module
from linkage_vibration.prediction import levels
from linkage_vibration.prediction.ensemble import EnsembleResponses, GroundMembers
from linkage_vibration.prediction.excitation import Excitation, Source, excitations_from_mapping
from linkage_vibration.prediction.ground import GroundTable
from linkage_vibration.prediction.level_cache import (
    MOST_FILES,
    LevelCache,
    cache_folder,
    level_cache,
)
from linkage_vibration.prediction.levels import LevelTable, kept_levels
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import ResonanceMonitor
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file
from linkage_vibration.table.table import Table, both_halves, load_table
from test.support.level_factors import level_factors

ARRAYS = {"values": np.random.default_rng(1).normal(size=(40, 1000)), "order": np.arange(7)}
SHAFT = {"speed": "pto", "orders": [1, 2], "force": [400.0, 90.0], "at": "E1.z", "at_speed": 540.0}
FIELD = {"speed": "ground", "terrain": {"class": "C"}, "raised": True}
EXCITATIONS = excitations_from_mapping({"shaft": SHAFT, "field": FIELD})
Shipped = tuple[Table, Mechanism, tuple[Excitation, ...]]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of the cache, which is empty."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "linkage_vibration"


def read_shipped() -> Shipped:
    """Return the table of the shipped tractor, with a shaft and the ground."""
    mechanism = read_mechanism(config_file(DEFAULT_MECHANISM))
    return load_table(None, mechanism), mechanism, EXCITATIONS


@pytest.fixture(scope="module")
def shipped() -> Shipped:
    """Return the same, read once."""
    return read_shipped()


def refuse() -> dict[str, Any]:
    """Fail, since nothing is to be computed."""
    raise AssertionError("This was computed again.")


def is_kept(part: str = "cells", key: str = "key") -> bool:
    """Return whether a part is in a file that is used, which then has the right arrays."""
    try:
        arrays = LevelCache(key)(part, refuse)
    except AssertionError:
        return False
    assert arrays.keys() == ARRAYS.keys()
    assert all(np.array_equal(arrays[name], ARRAYS[name]) for name in ARRAYS)
    return True


def keep(part: str = "cells", key: str = "key") -> None:
    """Write the file of a part."""
    assert LevelCache(key)(part, lambda: ARRAYS) is ARRAYS


def speeds(ground: float, n: int) -> NDArray[np.float64]:
    """Return speeds of all sources, (n_sources, n), with this one over ground, m/s."""
    return np.tile([[2000.0], [540.0], [ground]], n)


def all_bytes(of: MessageColumns) -> bytes:
    """Return the bytes of all columns."""
    return b"".join(np.asarray(column).tobytes() for column in vars(of).values())


def results(of: LevelTable) -> list[bytes]:
    """Return the bytes of levels with their factors, and of what a monitor reports."""
    predictor, limit = of.predictor, 0.33
    angles, at = np.linspace(*of.alpha3_range, 33), speeds(7.0, 33)
    monitor = ResonanceMonitor(EXCITATIONS, levels=of)
    for source, speed in zip(Source, at[:, 0], strict=True):
        monitor.set_fixed(source, float(speed))
    assessed = [monitor.assess(predictor.predict(2.8), 0.0, 10**10 + 10**8 * k) for k in range(15)]
    assert np.isfinite(assessed[-1].quiet_speed)
    assert np.isfinite(assessed[-1].total_load_ratio_factor)
    factors = [values.tobytes() for values in level_factors(of, angles, at, limit).values()]
    return [*factors, *(all_bytes(each) for each in (of.at(angles, at), *assessed))]


def test_levels_are_the_same_to_the_last_bit(
    shipped: Shipped, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Levels, factors and quiet speeds are those without files, at the first start and the second.

    The first start writes four files, and the second one tabulates nothing.
    """
    expected = results(LevelTable(Predictor(shipped[0]), *shipped[1:]))
    assert not folder.exists()
    first = kept_levels(Predictor(shipped[0]), *shipped[1:])
    first.prepare()
    names = [path.name.partition("-")[0] for path in folder.iterdir()]
    assert sorted(names) == ["cells", "ground", "members", "modes"]
    assert results(first) == expected
    tabulate_nothing(monkeypatch)
    assert results(kept_levels(Predictor(shipped[0]), *shipped[1:])) == expected


def tabulate_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let whatever tabulates levels fail."""
    ground = (GroundTable, "_tabulated"), (GroundMembers, "_tabulated")
    for owner, name in ((levels, "_sampled"), (EnsembleResponses, "_at_nodes"), *ground):
        monkeypatch.setattr(owner, name, lambda *_: refuse())


def test_the_ground_is_tabulated_when_a_speed_is_known(
    shipped: Shipped, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a ground speed, levels and factors need no table of the ground; with one, they do.

    What a node prepares before it is active, it does not compute again.
    """
    shipped_levels = LevelTable(Predictor(shipped[0]), *shipped[1:])
    angles, limit = np.array([2.0, 2.5]), 0.33
    with monkeypatch.context() as patched:
        tabulate_nothing(patched)
        still = shipped_levels.at(angles, speeds(math.nan, 2))
        assert np.isfinite(still.load_ratios[:, 0]).all()
        assert np.isfinite(shipped_levels.factor_rows(angles, speeds(math.nan, 2), limit)).any()
        with pytest.raises(AssertionError, match="computed again"):
            shipped_levels.at(angles, speeds(7.0, 2))
        with pytest.raises(AssertionError, match="computed again"):
            shipped_levels.prepare()
    shipped_levels.prepare()
    tabulate_nothing(monkeypatch)
    # Those of a changed implement come from another process.
    for prepared in (shipped_levels, pickle.loads(pickle.dumps(shipped_levels))):
        assert np.isfinite(prepared.at(angles, speeds(7.0, 2)).load_ratios[:, -1]).all()
        assert np.isfinite(prepared.factor_rows(angles, speeds(7.0, 2), limit)).any()


def test_each_input_has_its_own_files(shipped: Shipped) -> None:
    """The key is the same in another process, and another for any change of what it is made of."""
    table, mechanism, excitations = shipped
    key = level_cache(*shipped).key
    again = (
        "from test.prediction.test_level_cache import *; print(level_cache(*read_shipped()).key)"
    )
    other_process = subprocess.run(
        [sys.executable, "-c", again], capture_output=True, text=True, check=True
    )
    assert other_process.stdout.strip() == key
    slower = replace(excitations[0], ratio=math.nextafter(excitations[0].ratio, 0.0))
    ends = mechanism.stroke
    last_bit = replace(mechanism, stroke=(ends[0], math.nextafter(ends[1], 0.0)))
    assert last_bit.model_hash == mechanism.model_hash  # which has twelve digits
    other = replace(table.vertical, slope_error=2.0 * table.vertical.slope_error)
    assert table.lateral is not None
    other = both_halves(other, table.lateral)
    keys = [
        key,
        level_cache(other, *shipped[1:]).key,
        level_cache(table, last_bit, excitations).key,
        level_cache(table, mechanism, (slower, *excitations[1:])).key,
        level_cache(table, mechanism, excitations[::-1]).key,
    ]
    assert len({*keys}) == len(keys)


def test_another_code_or_arithmetic_has_its_own_files(
    shipped: Shipped, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The key changes with the version of NumPy, a result of this machine, and a line of code."""
    keys = [level_cache(*shipped).key]
    with monkeypatch.context() as patched:
        patched.setattr(np, "__version__", "another")
        keys.append(level_cache(*shipped).key)
    with monkeypatch.context() as patched:
        patched.setattr(np, "exp", lambda values: np.nextafter(np.expm1(values) + 1.0, 0.0))
        keys.append(level_cache(*shipped).key)
    package = Path(cache_module.__file__).parents[1]
    for room in ("mechanics", "table", "prediction"):
        shutil.copytree(package / room, tmp_path / "copy" / room)
    copied = tmp_path / "copy/prediction/level_cache.py"
    monkeypatch.setattr(cache_module, "__file__", str(copied))
    assert level_cache(*shipped).key == keys[0]
    ground = copied.with_name("ground.py")
    ground.write_text(ground.read_text().replace("N_FREQUENCIES = 512", "N_FREQUENCIES = 256"))
    keys.append(level_cache(*shipped).key)
    assert len({*keys}) == len(keys)


def test_each_blas_kernel_has_its_own_files() -> None:
    """The results by which arithmetic is told differ between two kernels, if OpenBLAS has both."""
    code = "from linkage_vibration.prediction.level_cache import _rounding as r; print(hash(r()))"

    def printed(kernel: str) -> str:
        more = {"OPENBLAS_CORETYPE": kernel, "PYTHONHASHSEED": "0", "OPENBLAS_VERBOSE": "2"}
        command, env = [sys.executable, "-c", code], os.environ | more
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=env)
        return done.stdout + done.stderr

    outputs = [printed(kernel) for kernel in ("Prescott", "Nehalem")]
    cores = [re.findall(r"Core: (\w+)", output) for output in outputs]
    if not cores[0] or cores[0] == cores[1]:
        pytest.skip("this BLAS has not both kernels")
    first, second = (re.sub(r"Core: \w+", "", output).strip() for output in outputs)
    assert first != second


def test_what_is_kept_is_not_computed_again() -> None:
    """A part is kept for its key alone."""
    keep()
    assert is_kept()
    assert not is_kept(key="other")
    assert not is_kept(part="ground")


def spoil_bit(path: Path) -> None:
    """Change a bit of a number."""
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def spoil_shape(path: Path) -> None:
    """Let the header of an array promise fewer numbers, so that a reader stops before the end."""
    data = path.read_bytes()
    assert b"(40, 1000)" in data
    path.write_bytes(data.replace(b"(40, 1000)", b"(40, 0999)"))


def spoil_name(path: Path) -> None:
    """Give a file the name of another key."""
    keep(key="other")
    path.with_name("cells-other.npz").replace(path)


def spoil_by_pickle(path: Path) -> None:
    """Put a Python object in place of numbers."""
    np.savez(path, name=np.array(path.name), values=np.array([{}]))


def spoil_by_pipe(path: Path) -> None:
    """Put a pipe in place of the file, for which a reader would wait."""
    path.unlink()
    os.mkfifo(path)


def spoil_by_folder(path: Path) -> None:
    """Put a folder in place of the file."""
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize(
    ("spoil", "is_replaced"),
    [
        (spoil_bit, True),
        (spoil_shape, True),
        (spoil_name, True),
        (spoil_by_pickle, True),
        (lambda path: path.write_bytes(path.read_bytes()[:-100]), True),
        (lambda path: path.write_bytes(b""), True),
        (lambda path: path.write_text("no archive"), True),
        (spoil_by_pipe, False),
        (spoil_by_folder, False),
    ],
    ids=["bit", "shape", "name", "pickle", "cut", "empty", "text", "pipe", "folder"],
)
def test_a_file_that_is_not_right_is_not_used(
    spoil: Callable[[Path], None], is_replaced: bool, folder: Path
) -> None:
    """Damaged and foreign files are computed again and replaced; a pipe and a folder remain."""
    keep()
    assert is_kept()
    spoil(folder / "cells-key.npz")
    assert not is_kept()
    keep()
    assert is_kept() == is_replaced


def test_a_folder_that_cannot_be_written(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where there is no folder, no room or no home, levels are computed, and nothing is left."""
    monkeypatch.setattr(cache_module.np, "savez", no_room)
    keep()
    assert list(folder.iterdir()) == []
    monkeypatch.undo()
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    keep()
    assert not is_kept()
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", no_home)
    keep()
    assert not is_kept()


def no_room(path: Path, **arrays: Any) -> None:
    """Fail as a disk that is full while a file is written."""
    path.write_bytes(b"half")
    raise OSError(errno.ENOSPC, "No space left on device")


def no_home() -> Path:
    """Fail as for a user without a home."""
    raise RuntimeError("Could not determine home directory.")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_can_only_be_read(folder: Path) -> None:
    """What is there is used, and nothing else is written."""
    keep()
    folder.chmod(0o500)
    assert is_kept()
    keep(part="ground")
    assert not is_kept(part="ground")
    folder.chmod(0o700)


def test_where_the_files_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An absolute XDG_CACHE_HOME names the folder; else it is that of the XDG specification."""
    assert cache_folder() == tmp_path / "linkage_vibration"
    monkeypatch.setenv("HOME", "/home/someone")
    for value in ("", "relative/folder"):
        monkeypatch.setenv("XDG_CACHE_HOME", value)
        assert cache_folder() == Path("/home/someone/.cache/linkage_vibration")


def test_only_the_latest_files_are_kept(folder: Path) -> None:
    """With one file too many, that unused for longest is removed; with one fewer, all remain."""
    for k in range(MOST_FILES):
        keep(key=f"{k}")
        os.utime(folder / f"cells-{k}.npz", (k, k))
    assert len(list(folder.iterdir())) == MOST_FILES
    assert is_kept(key="0")  # used again
    keep(key="new")
    assert not is_kept(key="1")
    assert all(is_kept(key=key) for key in ("0", "2", f"{MOST_FILES - 1}", "new"))
    assert len(list(folder.iterdir())) == MOST_FILES


def test_many_at_once(folder: Path) -> None:
    """Programs that start at the same time all have the right arrays, and one file remains."""
    with ThreadPoolExecutor(8) as pool:
        kept = list(pool.map(lambda _: LevelCache("key")("cells", lambda: ARRAYS), range(40)))
    assert all(np.array_equal(each[name], ARRAYS[name]) for each in kept for name in ARRAYS)
    assert [path.name for path in folder.iterdir()] == ["cells-key.npz"]
    assert is_kept()
