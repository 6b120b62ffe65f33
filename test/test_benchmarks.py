# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Every benchmark can be imported, and the chart of error against time runs in a small setting."""

import csv
import io
import math
import shutil
import subprocess
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")


from benchmark.__main__ import STEPS
from benchmark.speed import assembled, coupled, paper_job
from benchmark.speed.__main__ import Settings, as_csv, read_csv, run, tables
from benchmark.speed.chart import CONFIGURATION, FRFS, INTERPOLATED, LIVE, PACKAGE, Point
from benchmark.speed.live_picture import draw_live
from benchmark.speed.picture import draw
from benchmark.speed.scene import MECHANISM, Scene, changed, frf_error, off_grid
from benchmark.speed.timing import Spread
from benchmark.stability import damping
from linkage_vibration.readers.mechanism import read_mechanism

ROOT = Path(__file__).resolve().parents[1]
# Codes that the benchmarks compare this package with, and that its tests do without.
PEERS = {"gmsh", "meshio", "pyFBS", "rerun", "sdynpy"}


@pytest.fixture(scope="module")
def points() -> list[Point]:
    """Two settings of every method of our own."""
    mechanism = changed(read_mechanism(MECHANISM), elements=8, modes=4)
    scene = Scene(
        mechanism,
        lines=np.linspace(0.0, 200.0, 41),
        angles=np.radians([95.0, 140.0]),
        live_angles=off_grid(mechanism.stroke, 20),
        fine=8,
    )
    settings = Settings(
        modes=(0, 3), elements=(2, 8), table_points=(6, 23), tolerances=(1e-3, 1e-6), rounds=2
    )
    return run(scene, settings, with_peers=False)


@pytest.mark.nightly(short="test_benchmark_is_imported")
def test_errors_fall_with_the_settings(points: list[Point]) -> None:
    """More modes, elements or points of a table bring every answer nearer to the reference."""
    families: dict[tuple[str, str], list[Point]] = {}
    for point in points:
        if not math.isnan(point.error) and "chosen" not in point.family:
            families.setdefault((point.part, point.family), []).append(point)
    assert {part for part, _ in families} == {CONFIGURATION, FRFS, LIVE, *INTERPOLATED}
    for (_, family), line in families.items():
        if family == coupled.NO_RESIDUAL:
            continue  # what it leaves out does not depend on the links' modes
        assert line[-1].error <= line[0].error
        assert all(0.0 < p.cost.low <= p.cost.median <= p.cost.high for p in line)


@pytest.mark.nightly(short="test_benchmark_is_imported")
def test_the_reference_is_met(points: list[Point]) -> None:
    """The sparse assembly with the reference's mesh agrees with the reference's dense modes."""
    own = [p for p in points if (p.family, p.setting) == (assembled.FAMILY, "8 elements")]
    assert {p.part for p in own} == {CONFIGURATION, FRFS}
    assert all(p.error < 1e-8 for p in own)


@pytest.mark.nightly(short="test_benchmark_is_imported")
def test_a_missing_answer_says_why(points: list[Point]) -> None:
    """LM-FBS has no natural frequencies, and the chart says so."""
    missing = [p for p in points if math.isnan(p.error) and p.missing]
    assert (CONFIGURATION, coupled.BATCHED) in {(p.part, p.family) for p in missing}


@pytest.mark.nightly(short="test_benchmark_is_imported")
def test_results_are_written(points: list[Point], tmp_path: Path) -> None:
    """Every point is a row of the CSV; the page has a table a part; the picture is a PNG."""
    text = as_csv(points)
    rows = list(csv.reader(io.StringIO(text)))
    assert len(rows) == len(points) + 1
    assert as_csv(read_csv(text)) == text
    assert any(PACKAGE in part for part in tables(points))
    draw(points, 1.5e-6, tmp_path / "chart.png")
    draw_live(points, Spread(1.5e-6, 1.4e-6, 1.6e-6), tmp_path / "live.png")
    for name in ("chart.png", "live.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.nightly(short="test_benchmark_is_imported")
def test_ways_of_the_paper_job_agree() -> None:
    """The fast way of the paper's job agrees with the unreduced one, and LM-FBS with itself."""
    whole = paper_job.paper_job()
    job = paper_job.Job(whole.mechanism, whole.angles[::23], whole.lines[::100])
    exact = list(paper_job.sparse(job))
    for name, tolerance in ((paper_job.FAST, 1e-4), (paper_job.FINER, 1e-5)):
        actual = paper_job.METHODS[name](job)
        assert max(map(frf_error, actual, exact)) < tolerance
    for plain, batched in zip(paper_job.as_written(job), paper_job.batched(job), strict=True):
        np.testing.assert_allclose(plain, batched, rtol=1e-6, atol=1e-7 * np.abs(batched).max())


@pytest.mark.nightly(short="test_benchmark_is_imported")
def test_a_train_of_any_size_grows() -> None:
    """The train used for growth closes, and LM-FBS and modes agree on it."""
    job = paper_job.job_of_train(3)
    assert len(job.mechanism.links) == 7
    small = paper_job.Job(job.mechanism, job.angles[::45], job.lines[::200], job.rows)
    for by_modes, by_frfs in zip(paper_job.shipped(small), paper_job.batched(small), strict=True):
        assert by_frfs.shape == (10, 11)
        assert frf_error(by_frfs, by_modes) < 1e-6


BENCHMARKS = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in (ROOT / "benchmark").rglob("*.py")
    if path.stem not in ("__init__", "__main__")
)


@pytest.mark.parametrize("name", BENCHMARKS)
def test_benchmark_is_imported(name: str) -> None:
    """Each benchmark is imported; one whose peer is not installed here names it."""
    try:
        import_module(name)
    except ModuleNotFoundError as error:
        peer = (error.name or "").split(".")[0]
        assert peer in PEERS, f"{name} needs {peer}, which `make test` should have installed"
        pytest.skip(f"{name} needs {peer}, which is installed by `make bench` alone")


def test_every_step_is_a_benchmark() -> None:
    """Each step of ``make bench`` is a module or a package that does something if it is run."""
    for step in STEPS:
        path = ROOT.joinpath("benchmark", *step.split("."))
        run = path / "__main__.py" if path.is_dir() else path.with_suffix(".py")
        assert '\nif __name__ == "__main__":\n' in run.read_text(encoding="utf-8"), step


@pytest.mark.nightly(alone="it installs what only benchmarks need")
def test_every_benchmark_is_imported_where_make_bench_runs_it(tmp_path: Path) -> None:
    """The environment of ``make bench``, made from a copy of the checkout, imports them all."""
    checkout = tmp_path / "checkout"
    made = shutil.ignore_patterns(".venv", ".git", "__pycache__", "build", "*.egg-info")
    shutil.copytree(ROOT, checkout, ignore=made)
    dry = subprocess.run(["make", "-n", "bench"], cwd=checkout, check=True, capture_output=True)
    (setup,) = (line for line in dry.stdout.decode().splitlines() if "setup.sh build" in line)
    subprocess.run(setup, shell=True, cwd=checkout, check=True)
    program = "import importlib, sys; [importlib.import_module(name) for name in sys.argv[1:]]"
    python = checkout / "build/bench/bin/python"
    subprocess.run([python, "-c", program, *BENCHMARKS], cwd=checkout, check=True)


def test_pairs_by_similarity_are_wrong() -> None:
    """The former pairing gives a mode of the hitch a slow and a fast root; the model does not."""
    solution = damping.HITCH.model(5e3).solve(math.radians(135.0))
    assert damping.plain_pairs(solution)[1][:3].max() > 1.0
    assert solution.damping_ratios[:3].max() < 0.1


def test_damper_from_zero_to_rigid() -> None:
    """The strongest damper leaves the modes of a linkage with a stiff spring in its place."""
    alpha3 = math.radians(damping.FOUR_BAR.alpha3_deg)
    poles = damping.sweep(damping.FOUR_BAR, np.array([1e8]))[0]
    ordered = np.sort(np.abs(poles[poles.imag > 0.0]))[:3] / (2.0 * math.pi)
    rigid = damping.FOUR_BAR.model(0.0, 1e12).solve(alpha3).natural_frequencies[:3]
    np.testing.assert_allclose(ordered, rigid, rtol=1e-4)
    slow = np.abs(poles[poles.imag == 0.0]).min()
    assert slow < 1.0
