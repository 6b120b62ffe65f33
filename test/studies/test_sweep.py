# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The file of a sweep, and sweeps that are interrupted: nothing is lost or built twice."""

import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.io import netcdf_file

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.studies.sweep import Designs, SweepError, read_designs, sweep
from linkage_vibration.studies.sweep.output import BUILT, GIVEN_UP, NOT_BUILDABLE
from linkage_vibration.support.process_pool import LocalPool
from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file
from linkage_vibration.table.tabulation import build_table

LENGTH, HEIGHT = "links.coupler.points.C", "links.rocker.section.height"
DENSITY = "links.crank.material.density"


def four_bar() -> Any:
    """Return a small linkage; it is tabulated quickly, and closes if its coupler has 0.23 m."""
    mapping = yaml.safe_load(config_file("four_bar.yaml").read_text())
    mapping["input"]["range_deg"] = [60.0, 120.0]
    for link in mapping["links"].values():
        link.update(elements=2, modes=2, material=dict(link["material"]))
    return mapping


def grid(lengths: list[float], heights: list[float]) -> Designs:
    """Return designs of the small linkage at seven angles."""
    alpha3 = np.radians(np.linspace(60.0, 120.0, 7)).clip(math.radians(60.0), math.radians(120.0))
    values = (tuple(lengths), tuple(heights))
    return Designs(four_bar(), Path("four_bar.yaml"), (LENGTH, HEIGHT), values, alpha3, 1e-3)


@pytest.fixture
def designs() -> Designs:
    """Return six designs."""
    return grid([0.44, 0.45], [0.020, 0.022, 0.024])


@pytest.fixture
def space(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes a sweep of the small linkage, with other keys if given."""

    def write(**changed: Any) -> Path:
        (tmp_path / "four_bar.yaml").write_text(yaml.safe_dump(four_bar(), sort_keys=False))
        asked = {
            "mechanism": "four_bar.yaml",
            "parameters": {LENGTH: {"from": 0.44, "to": 0.46, "points": 3}, HEIGHT: [0.02, 0.03]},
            "angles_deg": {"from": 60, "to": 120, "points": 7},
            "tolerance": 1e-3,
        }
        path = tmp_path / "space.yaml"
        path.write_text(yaml.safe_dump({**asked, **changed}, sort_keys=False))
        return path

    return write


def in_one_go(designs: Designs, output: Path) -> Path:
    """Return the file that an uninterrupted sweep writes."""
    with ThreadPoolExecutor(1) as executor:
        sweep(designs, output, executor)
    return output


def assert_same_file(found: Path, expected: Path) -> None:
    """Assert that two files hold the same, up to rounding, which the layout of memory changes."""
    with netcdf_file(found, mmap=False) as one, netcdf_file(expected, mmap=False) as other:
        assert one._attributes == other._attributes
        assert one.dimensions == other.dimensions
        assert list(one.variables) == list(other.variables)
        for name, variable in one.variables.items():
            values, wanted = variable[:], other.variables[name][:]
            if name == "interpolation_error":
                np.testing.assert_allclose(values, wanted, rtol=1e-6, atol=1e-14)
            elif values.dtype.kind == "f":
                np.testing.assert_allclose(values, wanted, rtol=1e-11, atol=0.0)
            else:
                np.testing.assert_array_equal(values, wanted)


def parts(output: Path) -> list[str]:
    """Return the names of the finished designs beside an output."""
    found = (path.name for path in Path(f"{output}.parts").iterdir())
    return sorted(name for name in found if name[0] != "." and name != "lock")


def test_shipped_sweep_is_read() -> None:
    """Values are lists or evenly spaced, and angles are turned into radians."""
    shipped = read_designs(config_file("sweeps/implement.yaml"))
    assert shipped.shape == (4, 3, 3, 2)
    assert shipped.size == 72
    assert shipped.point(0) == (400.0, 100.0, 0.340, 0.025)
    assert shipped.point(71) == (1600.0, 400.0, 0.392, 0.029)
    assert shipped.mechanism(70).rigid_bodies[0].mass == 1600.0
    assert shipped.alpha3[[0, -1]].tolist() == [math.radians(90.0), math.radians(180.0)]


def test_file_holds_what_the_tables_say(tmp_path: Path) -> None:
    """Each design has its table's curves in its place, or a message why it has none."""
    designs = grid([0.20, 0.45, 0.46], [0.02, 0.03])
    output = tmp_path / "out.nc"
    with ThreadPoolExecutor(1) as executor:
        result = sweep(designs, output, executor)
    assert list(result.messages) == [0, 1]  # the coupler is too short, with either rocker
    assert (result.built, result.kept, result.given_up) == (6, 0, 0)
    assert not Path(f"{output}.parts").exists()
    with netcdf_file(output, mmap=False) as file:
        variables = file.variables
        curves = variables["natural_frequencies"]
        assert curves.dimensions == (LENGTH, HEIGHT, "alpha3", "mode")
        assert curves.shape == (3, 2, 7, 3)
        assert variables["frf_peak_magnitude"].units == b"m/N"
        assert variables["status"][:].tolist() == [[NOT_BUILDABLE] * 2, [BUILT] * 2, [BUILT] * 2]
        assert np.isnan(curves[0]).all()
        assert not np.isnan(curves[1:]).any()
        message = variables["message"][0, 1].tobytes().rstrip(b"\0").decode()
        assert message == result.messages[1]
        assert variables[LENGTH][:].tolist() == [0.20, 0.45, 0.46]

        mapping = four_bar()
        mapping["links"]["coupler"]["points"]["C"] = 0.46
        mapping["links"]["rocker"]["section"]["height"] = 0.03
        mechanism = mechanism_from_mapping(mapping)
        table = build_table(LinkageModel(mechanism), 1e-3)
        expected = table.evaluate(designs.alpha3)
        place = (2, 1)
        # Two builds agree to rounding only, because the alignment of memory changes the last bits.
        same = partial(np.testing.assert_allclose, rtol=1e-11, atol=0.0)
        same(curves[place], expected[:, :3])
        same(variables["damping_ratios"][place], expected[:, 3:6])
        same(variables["frf_peak_frequency"][place], expected[:, 6])
        same(variables["frf_peak_magnitude"][place], expected[:, 7])
        assert variables["model_hash"][place].tobytes().decode() == mechanism.model_hash
        assert 0.0 < variables["interpolation_error"][place] < 1e-3


def test_numbers_of_the_tractor_are_swept(tmp_path: Path) -> None:
    """The mass of the base and the bulk modulus of the oil change the modes as they should."""
    mapping = yaml.safe_load(config_file(DEFAULT_MECHANISM).read_text())
    mapping["input"]["range_deg"] = [135.0, 145.0]
    for link in mapping["links"].values():
        link.update(elements=4, modes=3)
    del mapping["uncertainty"]
    paths = ("base.mass", "springs.lift_cylinders.cylinder.bulk_modulus")
    values, angles = ((3000.0, 6000.0), (0.8e9, 1.6e9)), np.radians([136.0, 144.0])
    designs = Designs(mapping, Path("tractor.yaml"), paths, values, angles, 1e-3)
    with netcdf_file(in_one_go(designs, tmp_path / "tractor.nc"), mmap=False) as found:
        swept = found.variables["natural_frequencies"][:].copy()
    for index in range(designs.size):
        model = LinkageModel(designs.mechanism(index))
        exact = [model.solve(at).natural_frequencies[: swept.shape[-1]] for at in angles.tolist()]
        np.testing.assert_allclose(swept.reshape(-1, *np.shape(exact))[index], exact, rtol=1e-3)
    assert (swept[0] > swept[1]).all(where=np.arange(swept.shape[-1]) < 2)  # a lighter tractor
    assert (swept[:, 0, ..., 5] < swept[:, 1, ..., 5]).all()  # softer oil


def test_xarray_opens_the_file(tmp_path: Path, designs: Designs) -> None:
    """Xarray opens the file with its coordinates, units and text."""
    xarray = pytest.importorskip("xarray", reason="xarray is not installed")
    in_one_go(designs, tmp_path / "out.nc")
    with xarray.open_dataset(tmp_path / "out.nc") as data:
        first = data.natural_frequencies.sel({LENGTH: 0.45, HEIGHT: 0.022, "mode": 1})
        assert first.dims == ("alpha3",)
        assert first.attrs["units"] == "Hz"
        assert set(data.message.values.ravel()) == {""}
        assert len(data.model_hash.values[0, 0]) == 64
        assert len(data.natural_frequencies.to_dataframe()) == 6 * 7 * 3


def test_sweep_continues_where_it_stopped(tmp_path: Path, designs: Designs) -> None:
    """Finished designs are kept, damaged ones are rebuilt, and the file is the same."""
    whole = in_one_go(designs, tmp_path / "whole.nc")
    output = tmp_path / "out.nc"
    counted: list[int] = []

    def stop(finished: int) -> None:
        counted.append(finished)
        if sum(counted) == 4:
            raise KeyboardInterrupt

    with ThreadPoolExecutor(1) as executor, pytest.raises(KeyboardInterrupt):
        sweep(designs, output, executor, stop)
    assert not output.exists()
    kept = parts(output)
    assert len(kept) == 4
    for name, damaged in ((kept[0], b""), (kept[1], b"something else that is no part at all")):
        (Path(f"{output}.parts") / name).write_bytes(damaged)
    spoilt = bytearray((Path(f"{output}.parts") / kept[2]).read_bytes())
    spoilt[-3] ^= 1
    (Path(f"{output}.parts") / kept[2]).write_bytes(spoilt)

    counted.clear()
    with ThreadPoolExecutor(1) as executor:
        result = sweep(designs, output, executor, counted.append)
    assert (result.built, result.kept) == (6 - 1, 1)
    assert sum(counted) == 6
    assert_same_file(output, whole)
    assert not Path(f"{output}.parts").exists()


def test_finished_sweep_is_not_done_again(tmp_path: Path, designs: Designs) -> None:
    """A complete file is kept, even if parts were left; another sweep replaces it."""
    output = tmp_path / "out.nc"
    whole = in_one_go(designs, output).read_bytes()
    Path(f"{output}.parts").mkdir()
    with ThreadPoolExecutor(1) as executor:
        again = sweep(designs, output, executor)
        assert (again.built, again.kept, again.messages) == (0, 6, {})
        assert output.read_bytes() == whole
        other = sweep(grid([0.45], [0.02, 0.03]), output, executor)
    assert (other.built, other.kept) == (2, 0)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.nc"]


def test_equal_designs_are_built_once(tmp_path: Path) -> None:
    """Values that describe the same model share its table."""
    counted: list[int] = []
    with ThreadPoolExecutor(1) as executor:
        same = grid([0.45, 0.45 + 1e-15], [0.02])
        result = sweep(same, tmp_path / "out.nc", executor, counted.append)
    assert result.built == 1
    assert sum(counted) == 2
    with netcdf_file(tmp_path / "out.nc", mmap=False) as file:
        curves = file.variables["natural_frequencies"][:]
    assert np.array_equal(curves[0], curves[1])
    assert not np.isnan(curves).any()


def test_whole_run_may_be_killed(tmp_path: Path, space: Callable[..., Path]) -> None:
    """After kill -9 no process stays behind, and the next run builds only the rest."""
    heights = {"from": 0.02, "to": 0.04, "points": 10}
    path, output = space(parameters={HEIGHT: heights}), tmp_path / "out.nc"
    script = tmp_path / "run.py"
    script.write_text(
        "import sys\nfrom pathlib import Path\n"
        "from linkage_vibration.support.process_pool import LocalPool\n"
        "from linkage_vibration.studies.sweep import read_designs, sweep\n"
        "if __name__ == '__main__':\n"
        "    with LocalPool(1) as pool:\n"
        "        print(pool.submit(__import__('os').getpid).result(), flush=True)\n"
        "        sweep(read_designs(Path(sys.argv[1])), Path(sys.argv[2]), pool)\n"
    )
    command = [sys.executable, str(script), str(path), str(output)]
    run = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    worker = int(run.stdout.readline())
    wait_for(lambda: Path(f"{output}.parts").exists() and len(parts(output)) >= 2)
    run.kill()
    assert run.wait() == -signal.SIGKILL
    wait_for(lambda: not Path(f"/proc/{worker}").exists())
    run.stdout.close()
    kept = len(parts(output))
    assert 2 <= kept < 10
    designs = read_designs(path)
    with ThreadPoolExecutor(1) as executor:
        result = sweep(designs, output, executor)
    assert (result.built, result.kept, result.messages) == (10 - kept, kept, {})
    assert_same_file(output, in_one_go(designs, tmp_path / "whole.nc"))


def wait_for(what: Callable[[], bool], seconds: float = 120.0) -> None:
    """Wait until something holds, and fail if it does not."""
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, f"it did not happen within {seconds:g} s"
        time.sleep(0.01)


def test_killed_worker_costs_nothing(tmp_path: Path, designs: Designs) -> None:
    """The local pool replaces a killed worker; every design is built and stored once."""
    output = tmp_path / "out.nc"
    stored: list[int] = []
    killed: list[int] = []

    def kill(finished: int) -> None:
        stored.append(len(parts(output)))
        if finished and not killed:
            killed.append(multiprocessing.active_children()[0].pid or 0)
            os.kill(killed[0], signal.SIGKILL)

    with LocalPool(1) as pool:
        result = sweep(designs, output, pool, kill)
        assert pool.submit(os.getpid).result() not in killed
    assert len(killed) == 1
    assert (result.built, result.messages) == (6, {})
    assert stored == [0, *range(1, 7)]  # at the start, then one more each time
    assert_same_file(output, in_one_go(designs, tmp_path / "whole.nc"))


class DeadlyPool(LocalPool):
    """A pool in which the second design ends its process each time."""

    submitted = 0

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a call; the second one kills its process instead."""
        self.submitted += 1
        if self.submitted == 2:
            return super().submit(signal.raise_signal, signal.SIGKILL)
        return super().submit(fn, *args, **kwargs)


def test_design_that_kills_is_given_up(tmp_path: Path) -> None:
    """A design whose process always dies is given up and reported; the next run tries again."""
    designs, output = grid([0.45], [0.020, 0.022, 0.024]), tmp_path / "out.nc"
    with DeadlyPool(1) as pool:
        result = sweep(designs, output, pool)
    assert list(result.messages) == [1]
    assert "died 3 times" in result.messages[1]
    assert result.given_up == 1
    with netcdf_file(output, mmap=False) as file:
        assert file.variables["status"][:].tolist() == [[BUILT, GIVEN_UP, BUILT]]
    with ThreadPoolExecutor(1) as executor:
        again = sweep(designs, output, executor)
    assert (again.built, again.kept, again.messages, again.given_up) == (1, 2, {}, 0)
    assert_same_file(output, in_one_go(designs, tmp_path / "whole.nc"))


def test_executor_that_ends_is_reported(tmp_path: Path, designs: Designs) -> None:
    """A broken or closed pool ends the sweep with an error; finished designs are kept."""
    output = tmp_path / "out.nc"
    with ThreadPoolExecutor(1) as closed:
        pass
    with pytest.raises(SweepError, match="run the sweep again"):
        sweep(designs, output, closed)
    spawn = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(1, spawn) as broken,
        pytest.raises(SweepError, match="pool is not usable"),
    ):
        broken.submit(signal.raise_signal, signal.SIGKILL).exception()
        sweep(designs, output, broken)
    with ThreadPoolExecutor(1) as executor:
        assert sweep(designs, output, executor).built == 6


def test_two_runs_do_not_mix(tmp_path: Path, designs: Designs) -> None:
    """A second run on the same output is refused while the first one runs."""
    output = tmp_path / "out.nc"
    refused: list[str] = []

    def intrude(finished: int) -> None:
        with pytest.raises(SweepError, match="another run") as raised:
            sweep(designs, output, executor)
        refused.append(str(raised.value))

    with ThreadPoolExecutor(1) as executor:
        assert sweep(designs, output, executor, intrude).built == 6
    assert len(refused) == 7


def test_output_that_cannot_be_written(tmp_path: Path, designs: Designs) -> None:
    """A missing folder is reported before anything is built."""
    with ThreadPoolExecutor(1) as executor, pytest.raises(SweepError, match="cannot be written"):
        sweep(designs, tmp_path / "none" / "out.nc", executor)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"mechanism": "none.yaml"}, "none.yaml: cannot be opened"),
        ({"mechanism": 3}, "mechanism: 3 is not text"),
        ({"parameters": {}}, "parameters: is empty"),
        ({"parameters": [1]}, "parameters: .* is not a mapping"),
        ({"parameters": {"links.none.count": [1]}}, "links.none.count: .* no key 'none'"),
        ({"parameters": {"name": [1]}}, "'four_bar' is not a number"),
        ({"parameters": {HEIGHT: []}}, "rocker.section.height: .* is not a list of values"),
        ({"parameters": {HEIGHT: 0.02}}, "is not a list of values"),
        ({"parameters": {HEIGHT: [0.02, 0.02]}}, "is listed twice"),
        ({"parameters": {HEIGHT: [0.02, math.inf]}}, "height.1: inf is not a finite"),
        ({"parameters": {HEIGHT: [0.02, "3 cm"]}}, "height.1: .*is text"),
        ({"parameters": {HEIGHT: {"from": 1, "to": 2}}}, "height.points: .*missing"),
        ({"parameters": {HEIGHT: {"from": 1, "to": 2, "points": 0}}}, "whole number"),
        (
            {"parameters": {HEIGHT: {"from": 1, "to": 2, "points": 3, "by": 1}}},
            "height.by: .*known",
        ),
        ({"parameters": {"response.modes": [2, 3]}}, "same number of modes"),
        ({"angles_deg": {"from": 0, "to": 120, "points": 7}}, "leaves the stroke"),
        ({"angles_deg": {"from": math.nan, "to": 120, "points": 7}}, "angles_deg.from: .*finite"),
        ({"tolerance": 0}, "tolerance: 0 is not greater"),
        ({"more": 1}, "more: this key is not known"),
    ],
)
def test_invalid_sweeps_are_refused(space: Callable[..., Path], changed: Any, words: str) -> None:
    """Each error names the file, the key and the fix."""
    with pytest.raises(SweepError, match=words) as raised:
        read_designs(space(**changed))
    assert "space.yaml" in str(raised.value)


def test_two_parameters_that_are_one_number(space: Callable[..., Path], tmp_path: Path) -> None:
    """Two parameters that an alias makes one number are refused; two paths of one are not."""
    rocker = "links.rocker.material.density"
    path = space(parameters={DENSITY: [7800.0, 7900.0], rocker: [7800.0, 8000.0]})
    assert read_designs(path).shape == (2, 2)
    shipped = config_file("four_bar.yaml").read_text()  # its links share a material by an alias
    (tmp_path / "four_bar.yaml").write_text(shipped)
    with pytest.raises(SweepError, match="are one number"):
        read_designs(path)
    text = path.read_text()
    path.write_text(yaml.safe_dump({**yaml.safe_load(text), "parameters": {DENSITY: [7900.0]}}))
    densities = {link.body.material.density for link in read_designs(path).mechanism(0).links}  # type: ignore[attr-defined]
    assert densities == {7900.0}
    both = {f"{DENSITY}, {rocker}": [7900.0]}
    path.write_text(yaml.safe_dump({**yaml.safe_load(text), "parameters": both}))
    assert read_designs(path).size == 1


def test_whole_numbers_and_signs(space: Callable[..., Path]) -> None:
    """Whole numbers and negative coordinates can be parameters."""
    mapping = {"links.rocker.modes": [1, 2], "ground.D.1": [-0.02, 0.0]}
    designs = read_designs(space(parameters=mapping))
    assert designs.mechanism(2).links[2].modes == 2
    assert dict(designs.mechanism(2).ground)["D"] == (0.5, -0.02)


def test_links_from_files_are_swept(space: Callable[..., Path], tmp_path: Path) -> None:
    """Every design has the link whose matrices are in a file beside the mechanism."""
    path = space(parameters={HEIGHT: [0.02, 0.03]})
    beams = read_designs(path)
    components = LinkageModel(beams.mechanism(0)).components
    coupler: Any = next(component for component in components if component.name == "coupler")
    dofs = np.array([str(dof) for dof in coupler.dofs])
    np.savez(tmp_path / "c.npz", mass=coupler.mass, stiffness=coupler.stiffness, dofs=dofs)
    mapping = four_bar()
    points = mapping["links"]["coupler"]["points"]
    file = {"kind": "matrices", "path": "c.npz"}
    mapping["links"]["coupler"] = {"points": points, "modes": 2, "file": file}
    (tmp_path / "four_bar.yaml").write_text(yaml.safe_dump(mapping, sort_keys=False))
    curves = []
    for number, designs in enumerate((beams, read_designs(path))):
        output = tmp_path / f"{number}.nc"
        in_one_go(designs, output)
        with netcdf_file(output, mmap=False) as read:
            curves.append(read.variables["natural_frequencies"][:])
    assert curves[1] == pytest.approx(curves[0], rel=1e-6)
