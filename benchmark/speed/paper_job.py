# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares methods on the paper's job, and measures how the cost of the job grows.

``python -m benchmark.speed.paper_job --draw`` only draws the picture again, from the results.

The job is 11 FRFs in 46 configurations on the lines from 0 to 200 Hz in steps of 0.1 Hz. It begins
with the mechanism file, so it includes kinematics, reduction and component FRFs.
"""

import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.linalg import block_diag
from tqdm import tqdm

from benchmark.report import RESULTS, machine, publish, table
from benchmark.speed import coupled, peers
from benchmark.speed.assembled import sparse_frf
from benchmark.speed.scene import LINES, MECHANISM, SWEEP, Rows, Scene, changed, eleven, frf_error
from benchmark.speed.timing import Spread, pin_threads, seconds, spread, turns
from benchmark.speed.train import train
from linkage_vibration.drawing.palette import COLOURS, INK
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import Configuration
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.response import far_poles, in_reach
from linkage_vibration.readers.mechanism import read_mechanism

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

PICTURE = Path(__file__).parents[2] / "docs" / "pictures" / "paper_job.png"
ROUNDS = 5
_SIZE = 13  # of text in the picture, in points
MODES = 5  # per link, with which all FRFs together are within 1e-4
MORE = 10  # per link, with which each FRF is within 1e-4
_BLOCK = 64  # configurations that share far poles
FAST, SHIPPED = f"null space, {MODES} modes a link", "null space, as shipped, all modes"
FINER = f"null space, {MORE} modes a link"
BATCHED, WRITTEN = "LM-FBS, batched", "LM-FBS as written, eq. 19"
SDYNPY, SDYNPY_MODES = "SDynPy by FRFs", "SDynPy by modes"
SDYNPY_HELD = "SDynPy by FRFs, ground held before"
PYFBS, SPARSE = "pyFBS", "assembled, unreduced, sparse"
_AT_ONCE = {SPARSE}  # run only once, because it takes longer than all others together


@dataclass(frozen=True, slots=True)
class Job:
    """The FRFs to compute."""

    mechanism: Mechanism
    angles: FloatArray  # rad
    lines: FloatArray  # Hz, from 0
    rows: Rows = eleven


Method = Callable[[Job], Iterator[ComplexArray]]
"""Yields the FRFs of one configuration after the other, (n_lines, 11)."""


def by_modes(job: Job, modes: int) -> Iterator[ComplexArray]:
    """Null space and pole-residue form; shared far poles replace the modes above the band."""
    model = LinkageModel(changed(job.mechanism, modes=modes))
    band = (float(job.lines[0]), float(job.lines[-1]))
    for start in range(0, len(job.angles), _BLOCK):
        result = [
            coupled.eleven_functions(model, float(alpha3), job.rows)
            for alpha3 in job.angles[start : start + _BLOCK]
        ]
        n_near = max(int(in_reach(functions.stiffness, band).sum()) for functions in result)
        far = far_poles(
            np.concatenate([functions.stiffness[n_near:] for functions in result]),
            np.concatenate([functions.decay[n_near:] for functions in result]),
            band,
        )
        for functions in result:
            kept = np.arange(len(functions.decay)) < n_near
            yield functions.condensed(kept, far).frf(job.lines)[:, :, 0]


def shipped(job: Job) -> Iterator[ComplexArray]:
    """Null space and pole-residue form with every mode of the shipped linkage."""
    model = LinkageModel(job.mechanism)
    for alpha3 in job.angles:
        yield coupled.eleven_functions(model, float(alpha3), job.rows).frf(job.lines)[:, :, 0]


def batched(job: Job) -> Iterator[ComplexArray]:
    """LM-FBS on all lines at once; the ground's constraints are applied to the components."""
    model = LinkageModel(job.mechanism)
    blocks = coupled.held_frfs(model, job.lines[1:])
    for alpha3 in job.angles:
        yield coupled.batched(model, blocks, float(alpha3), job.rows)


def as_written(job: Job) -> Iterator[ComplexArray]:
    """LM-FBS line by line, with full matrices."""
    model = LinkageModel(job.mechanism)
    blocks = coupled.component_frfs(model, job.lines[1:])
    full = np.stack([block_diag(*matrices) for matrices in zip(*blocks, strict=True)])
    for alpha3 in job.angles:
        yield coupled.as_written(model, full, float(alpha3))


def sdynpy_frfs(job: Job, held: bool = False) -> Iterator[ComplexArray]:
    """SDynPy's LM-FBS."""
    model = LinkageModel(job.mechanism)
    couple = peers.SdynpyFrfs(model, job.lines[1:], job.rows, held=held)
    for alpha3 in job.angles:
        yield couple(float(alpha3))


def sdynpy_modes(job: Job) -> Iterator[ComplexArray]:
    """SDynPy's assembly and modal superposition."""
    couple = peers.SdynpyModes(LinkageModel(job.mechanism))
    for alpha3 in job.angles:
        yield couple.frf(float(alpha3), job.lines)


def pyfbs(job: Job) -> Iterator[ComplexArray]:
    """LM-FBS with pyFBS's pseudo-inverse."""
    couple = peers.PyfbsCoupling(LinkageModel(job.mechanism), job.lines[1:])
    for alpha3 in job.angles:
        yield couple(float(alpha3))


def sparse(job: Job) -> Iterator[ComplexArray]:
    """Solve the assembly without reduction."""
    model = LinkageModel(job.mechanism, reduced=False)
    for alpha3 in job.angles:
        yield sparse_frf(model, float(alpha3), job.lines)


METHODS: dict[str, Method] = {
    FAST: partial(by_modes, modes=MODES),
    FINER: partial(by_modes, modes=MORE),
    SHIPPED: shipped,
    BATCHED: batched,
    WRITTEN: as_written,
    SDYNPY: sdynpy_frfs,
    SDYNPY_HELD: partial(sdynpy_frfs, held=True),
    SDYNPY_MODES: sdynpy_modes,
    PYFBS: pyfbs,
    SPARSE: sparse,
}
_NEEDS = {SDYNPY: "sdynpy", SDYNPY_HELD: "sdynpy", SDYNPY_MODES: "sdynpy", PYFBS: "pyfbs"}


def run(method: Method, job: Job) -> None:
    """Do a job and discard the result."""
    for _ in method(job):
        pass


def paper_job() -> Job:
    """Return the paper's job."""
    return Job(read_mechanism(MECHANISM), SWEEP, LINES)


@dataclass(frozen=True, slots=True)
class Outcome:
    """The cost and the error of a method on the paper's job.

    Attributes
    ----------
    seconds : list of float
        Time of each round, s.
    error : float
        Relative L2 error of all FRFs in the worst configuration.
    worst_frf : float
        Relative L2 error of the worst single FRF.
    memory : tuple of float
        Peak of a process that does only this job, and the part that the job added, MB.
    """

    seconds: list[float]
    error: float
    worst_frf: float
    memory: tuple[float, float]


def side_by_side(names: list[str], step: Callable[[], object]) -> dict[str, Outcome]:
    """Run methods in turn; ``step`` is called `ROUNDS` + 2 times for each, and once before."""
    job = paper_job()
    scene = Scene(job.mechanism, job.lines, job.angles, job.angles)
    exact = scene.reference(job.angles)[1]
    step()
    errors = {}
    for name in names:
        result = [
            (frf_error(frf, right), _worst_frf(frf, right))
            for frf, right in zip(METHODS[name](job), exact, strict=True)
        ]
        errors[name] = [max(column) for column in zip(*result, strict=True)]
        step()
    jobs = {name: partial(run, METHODS[name], job) for name in names}
    repeated = {name: work for name, work in jobs.items() if name not in _AT_ONCE}
    taken = turns(repeated, ROUNDS, step=step)
    for name in _AT_ONCE.intersection(names):
        taken[name] = [seconds(jobs[name])]
        for _ in range(ROUNDS):
            step()
    outcomes = {}
    for name in names:
        memory = peak_memory(name)
        error, worst_frf = errors[name]
        outcomes[name] = Outcome(taken[name], error, worst_frf, memory)
        step()
    return outcomes


def _worst_frf(result: ComplexArray, exact: ComplexArray) -> float:
    exact = exact[len(exact) - len(result) :]
    apart = np.linalg.norm(result - exact, axis=0) / np.linalg.norm(exact, axis=0)
    return float(apart.max())


def peak_memory(name: str) -> tuple[float, float]:
    """Return the peak memory of a process that does the job, and the part of the job, MB."""
    command = [sys.executable, "-m", "benchmark.speed.paper_job", "--memory", name]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    before, after = map(float, done.stdout.split()[-2:])
    return after, after - before


def _print_memory(name: str) -> None:
    """Do the job once and print the memory before it and its peak, MB (Linux)."""
    tiny = Job(read_mechanism(MECHANISM), SWEEP[:1], LINES[:3])
    run(METHODS[name], tiny)  # imports what the method needs
    Path("/proc/self/clear_refs").write_text("5")  # resets the peak to the present use
    before = _peak()
    run(METHODS[name], paper_job())
    print(before, _peak())


def _peak() -> float:
    """Return the peak memory of this process, MB; `getrusage` would inherit the parent's."""
    status = Path("/proc/self/status").read_text()
    return float(status.split("VmHWM:")[1].split()[0]) / 1024.0


@dataclass(frozen=True, slots=True)
class Growth:
    """The cost of the job over its size.

    Attributes
    ----------
    sizes : list of float
        Number of lines, configurations or links.
    seconds : list of float
        Time of the whole job, s.
    """

    sizes: list[float]
    seconds: list[float]

    @property
    def slope(self) -> float:
        """Slope of the straight line through the logarithms."""
        return float(np.polyfit(np.log(self.sizes), np.log(self.seconds), 1)[0])

    @property
    def last_slope(self) -> float:
        """Slope between the two largest sizes, where fixed costs matter least."""
        x, y = np.log(self.sizes[-2:]), np.log(self.seconds[-2:])
        return float((y[1] - y[0]) / (x[1] - x[0]))


LINES_GROW, ANGLES_GROW, LINKS_GROW = "lines", "configurations", "links"
_FACTORS = {FAST: (1, 10, 100), BATCHED: (1, 10), SDYNPY: (0.1, 1)}
_CELLS = {FAST: (1, 4, 8, 16, 32), BATCHED: (1, 4, 8, 16, 32), SDYNPY: (1, 4, 8)}
# Lines of a train's LM-FBS, which inverts a matrix with a row for every constraint on each; they
# are run in one configuration and in three, from which the job's time is put together.
_FEW = 101


def growth(names: list[str], step: Callable[[], object]) -> dict[tuple[str, str], Growth]:
    """Measure how the job's cost grows; ``step`` is called `steps_of_growth` times."""
    base = paper_job()
    result = {}
    for name in names:
        method = METHODS[name]
        for way in (LINES_GROW, ANGLES_GROW):
            sizes, taken = [], []
            for factor in _FACTORS[name]:
                job = _grown(base, way, factor)
                sizes.append(float(len(job.lines if way == LINES_GROW else job.angles)))
                repeats = 3 if factor <= 1 else 1
                taken.append(min(seconds(partial(run, method, job)) for _ in range(repeats)))
                step()
            result[name, way] = Growth(sizes, taken)
        sizes, taken = [], []
        for n_cells in _CELLS[name]:
            job = job_of_train(n_cells)
            sizes.append(float(len(job.mechanism.links)))
            if name == FAST:
                taken.append(min(seconds(partial(run, method, job)) for _ in range(2)))
            else:
                taken.append(_put_together(method, job))
            step()
        result[name, LINKS_GROW] = Growth(sizes, taken)
    return result


def steps_of_growth(names: list[str]) -> int:
    """Return how many measurements `growth` takes."""
    return sum(2 * len(_FACTORS[name]) + len(_CELLS[name]) for name in names)


def _grown(job: Job, way: str, factor: float) -> Job:
    if way == LINES_GROW:
        n = round(factor * (len(job.lines) - 1)) + 1
        return Job(job.mechanism, job.angles, np.linspace(job.lines[0], job.lines[-1], n))
    n = max(2, round(factor * len(job.angles)))
    return Job(job.mechanism, np.linspace(job.angles[0], job.angles[-1], n), job.lines)


def job_of_train(n_cells: int) -> Job:
    """Return the paper's job for a train of four-bars."""
    mechanism = train(n_cells, MODES)
    angles = np.linspace(*mechanism.stroke, len(SWEEP))
    return Job(mechanism, angles, LINES, partial(_rows_of_train, n_cells))


def _put_together(method: Method, job: Job) -> float:
    """Return the time (s) of an LM-FBS job, calculated from runs on few lines.

    Reduction is done once, component FRFs for each line, and coupling for each line and
    configuration.
    """
    lines = np.linspace(job.lines[0], job.lines[-1], _FEW)
    share = len(job.lines) / _FEW
    first, three = (
        min(
            seconds(partial(run, method, Job(job.mechanism, angles, lines, job.rows)))
            for _ in range(2)
        )
        for angles in (job.angles[:1], job.angles[:3])
    )
    coupling = (three - first) / 2.0
    reduction = min(seconds(partial(LinkageModel, job.mechanism)) for _ in range(2))
    prepared = max(first - coupling - reduction, 0.0)
    return reduction + share * (prepared + len(job.angles) * coupling)


def _rows_of_train(
    n_cells: int, model: LinkageModel, configuration: Configuration
) -> tuple[FloatArray, FloatArray]:
    """Return the rows of eleven responses at a train's pins and a force at its first coupler."""
    places = [(f"B{1 + i // 2 % n_cells}", "xz"[i % 2]) for i in range(11)]
    return model.rows(places, configuration), model.rows([("B1", "x")], configuration)


def draw(page: str) -> None:
    """Draw the cost of the job by method, and how it grows with the links, from the page."""
    rows = [[cell.strip() for cell in row.split("|")[1:-1]] for row in page.splitlines()]
    costs = {
        row[0]: (float(row[1].split()[0]), row[2]) for row in rows if row[:1] and row[0] in METHODS
    }
    figure = Figure(figsize=(8.0, 11.5), layout="constrained")
    upper, lower = figure.subplots(2, 1, height_ratios=[1.5, 1.0])
    names = sorted(costs, key=lambda name: -costs[name][0])
    for row, name in enumerate(names):
        cost = costs[name][0]
        ours = name.startswith(("null", "LM-FBS, b"))
        upper.barh(row, cost - 0.5, left=0.5, color=COLOURS[0] if ours else "#bbbbbb", height=0.7)
        upper.text(1.1 * cost, row, f"{cost:.3g}", fontsize=_SIZE, va="center")
    upper.set_xscale("log")
    upper.set_xlim(0.5, 3.0 * max(cost for cost, _ in costs.values()))
    labels = [f"{name}\nerror {costs[name][1]}" for name in names]
    upper.set_yticks(range(len(names)), labels)
    upper.set_title("The paper's task: time by method", loc="left", fontsize=15, color=INK)
    upper.set_xlabel("time, in that of the first row (blue: this package)", fontsize=_SIZE)
    styles = {FAST: (COLOURS[0], "o"), BATCHED: (COLOURS[2], "s"), SDYNPY: (COLOURS[1], "^")}
    ticks: set[float] = set()
    for way, name, *columns in (row for row in rows if len(row) == 6):
        if way == LINKS_GROW and name in styles:
            sizes, times = (list(map(float, words.split())) for words in columns[:2])
            colour, marker = styles[name]
            lower.plot(sizes, times, color=colour, marker=marker, markersize=7)
            place = (sizes[-1], times[-1])
            lower.annotate(
                name,
                place,
                (0, -75 if name == FAST else 9),
                textcoords="offset points",
                fontsize=_SIZE,
                color=colour,
                ha="right",
            )
            ticks |= set(sizes)
    lower.set_xscale("log")
    lower.set_yscale("log")
    lower.set_xticks(sorted(ticks), [f"{tick:g}" for tick in sorted(ticks)])
    lower.minorticks_off()
    lower.margins(y=0.15)
    lower.set_xlabel("links", fontsize=_SIZE)
    lower.set_ylabel("time, in the same unit", fontsize=_SIZE)
    lower.set_title("The same task with more links", loc="left", fontsize=15, color=INK)
    lower.grid(True, color="#dddddd", linewidth=0.5)
    for axes in (upper, lower):
        axes.tick_params(labelsize=_SIZE)
        axes.spines[["top", "right"]].set_visible(False)
    draft = PICTURE.with_suffix(".part")
    figure.savefig(draft, format="png", dpi=100)
    draft.replace(PICTURE)


def report(
    outcomes: Mapping[str, Outcome], grown: Mapping[tuple[str, str], Growth], missing: list[str]
) -> list[str]:
    """Return the parts of the result page."""
    unit = spread(outcomes[FAST].seconds).median
    rows = []
    for name, outcome in outcomes.items():
        ratio = _ratio(outcome, outcomes[FAST])
        peak, added = outcome.memory
        rows.append(
            [
                name,
                str(ratio) if len(outcome.seconds) > 1 else f"{ratio.median:.3g} (once)",
                f"{outcome.error:.1e}",
                f"{outcome.worst_frf:.1e}",
                f"{peak:.0f}",
                f"{added:.0f}",
            ]
        )
    columns = ["method", "time", "error", "worst FRF", "peak, MB", "of it the job's, MB"]
    parts = [
        "This page compares methods on the job of the paper: 11 FRFs of `three_point_linkage` in "
        "46 configurations on 2001 lines from 0 to 200 Hz. LM-FBS begins at 0.1 Hz, because "
        "floating links have no receptance at 0 Hz. The job begins with the mechanism file, so it "
        "includes kinematics, reduction and component FRFs. Times are processor times on one "
        f"thread, in units of that of '{FAST}': medians (and quartiles) of {ROUNDS} rounds in "
        "which the methods take turns, after a warm-up. Errors are relative to the linkage with 96 "
        "elements per link, unreduced: the L2 norm of all eleven FRFs, and of the worst single "
        "one, in the worst configuration. If no number of modes is given, links have 20 "
        "fixed-interface modes as shipped. Peak memory is that of a process that does only this "
        "job, including its imports.",
        table(columns, rows),
    ]
    if SDYNPY in outcomes:
        parts += [
            f"'{theirs}' takes {_ratio(outcomes[theirs], outcomes[ours])} times as long as "
            f"'{ours}'."
            for theirs, ours in (
                (SDYNPY, FAST),
                (SDYNPY, FINER),
                (SDYNPY_MODES, FAST),
                (SDYNPY, BATCHED),
                (SDYNPY_HELD, BATCHED),
            )
        ]
    if missing:
        parts.append(f"Not installed here: {', '.join(missing)}.")
    rows = [
        [
            way,
            name,
            " ".join(f"{size:g}" for size in growth.sizes),
            " ".join(f"{taken / unit:.3g}" for taken in growth.seconds),
            f"{growth.slope:.2f}",
            f"{growth.last_slope:.2f}",
        ]
        for (name, way), growth in grown.items()
    ]
    parts += [
        "## Growth of the cost",
        "The table shows how the cost grows with the number of lines, configurations or links, "
        "while the other two stay as in the paper. The links are those of a train of four-bars "
        f"with {MODES} modes per link. The slope is that of the logarithms, by least squares and "
        f"between the two largest sizes. LM-FBS on trains was run on {_FEW} lines in 1 and 3 "
        "configurations, from which the time of the job is calculated. LM-FBS was left out if it "
        "would take minutes.",
        table(["grows", "method", "sizes", "time", "slope", "at the end"], rows),
    ]
    return parts


def _ratio(first: Outcome, second: Outcome) -> Spread:
    """Return the ratio of the times of two methods, computed in each round."""
    pairs = zip(first.seconds, second.seconds, strict=False)  # one of them was run only once
    return spread([each / other for each, other in pairs])


def main() -> None:
    """Measure everything, and write the page and the picture."""
    pin_threads("benchmark.speed.paper_job")
    if sys.argv[1:2] == ["--memory"]:
        _print_memory(sys.argv[2])
        return
    if sys.argv[1:] == ["--draw"]:
        draw((RESULTS / "paper_job.md").read_text())
        return
    lacking = {name for name, package in _NEEDS.items() if peers.lacks(package)}
    names = [name for name in METHODS if name not in lacking]
    growing = [name for name in _FACTORS if name in names]
    with tqdm(total=1 + (ROUNDS + 2) * len(names) + steps_of_growth(growing)) as bar:
        outcomes = side_by_side(names, bar.update)
        grown = growth(growing, bar.update)
    publish(
        "speed.paper_job",
        "The paper's job",
        report(outcomes, grown, sorted(lacking)),
        f"{machine(*peers.installed())}; one BLAS thread",
    )
    draw((RESULTS / "paper_job.md").read_text())


if __name__ == "__main__":
    main()
