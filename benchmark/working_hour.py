# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Generates an hour of work, and measures how often it warns: ``python -m benchmark working_hour``.

A tractor with a power harrow or a plough idles, drives on the road, ploughs and harrows with turns
at the headland, and starts its PTO. Warnings are compared with the forces of a time integration.
"""

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from benchmark.force_integration import EVERY, STEP, PinForces, Run, running
from benchmark.report import RESULTS, machine, publish, table
from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE
from linkage_vibration.drawing.palette import COLOURS, INK, PEAK
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.messages.topics import log_topic
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.prediction.severity import ResonanceState
from linkage_vibration.prediction.verdict import Drive, contributions, episodes
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.review.log import read_log
from linkage_vibration.support.resources import DEFAULT_EXCITATIONS, DEFAULT_MECHANISM, config_file

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SEED, HOUR = 20, 3600.0  # s
RATE = 100  # Hz, of the true motion
JOINT_RATE, SPEED_RATE = 50, 10  # Hz, of the sensors
ENCODER_STEP = 2.0 * math.pi / 2**14  # rad
SPEED_STEPS = {Source.ENGINE: 0.125, Source.PTO: 0.125, Source.GROUND: 1.0 / 256.0 / 3.6}  # J1939
START = 1_767_225_600 * 10**9  # ns
KINDS = "idle", "road", "plough", "headland", "run-up", "harrow"
WINDOW = 1.0  # s, over which forces are averaged
CLEARLY = 1.5  # times the limit: what must not be missed
# What is asked: largest shares of the time a healthy machine warns, and of the time that is missed.
MOST_WARNED, MOST_MISSED = 0.1, 0.01
# Healthy machines on ground of these classes; the first one is that of the file.
GROUNDS = {"healthy": "B", "healthy, class C": "C", "healthy, class D": "D"}
EVEN = "healthy, even ground"
# Amplitudes with a fault, on even ground: a shaft that is bent has the unbalance 10 kg 10 mm at
# the speed of the file, and a flat spot of a tyre is 10 mm deep.
FAULTS: dict[str, dict[str, tuple[str, float]]] = {
    EVEN: {},
    "bent cardan shaft": {"pto_shaft": ("force", 10.0 * 10e-3 * 105.0**2)},
    "flat spot of a tyre": {"tyre_lugs": ("base_displacement", 10e-3)},
}


@dataclass(frozen=True, eq=False)
class Work:
    """What a tractor does, and the kind of work at each time."""

    run: Run
    kind: NDArray[np.int64]  # (n,), indices of `KINDS`


@dataclass(frozen=True)
class _Phase:
    """Some time of one kind of work, with what its end is like."""

    kind: str
    duration: float  # s
    angle: float  # deg
    engine: float  # rpm
    pto: float  # rpm
    ground: float  # m/s


def _phases(rng: np.random.RandomState, duration: float) -> list[_Phase]:
    """Return what a tractor does one after the other."""
    phases: list[_Phase] = []
    jobs = ["road", "plough", "road", "harrow", "harrow"]
    while sum(phase.duration for phase in phases) < duration:
        for job in jobs:
            phases.append(
                _Phase("idle", rng.uniform(20, 60), 120.0, rng.uniform(800, 900), 0.0, 0.0)
            )
            if job == "road":
                for _ in range(rng.randint(3, 7)):
                    speed = rng.uniform(4.0, 11.0)
                    engine = rng.uniform(1300, 2150)
                    phases.append(_Phase("road", rng.uniform(20, 60), 105.0, engine, 0.0, speed))
            elif job == "plough":
                for _ in range(rng.randint(3, 6)):
                    depth, engine = rng.uniform(160, 170), rng.uniform(1800, 2150)
                    speed = rng.uniform(1.6, 2.8)
                    phases.append(_Phase("plough", rng.uniform(50, 90), depth, engine, 0.0, speed))
                    phases.append(_Phase("headland", rng.uniform(12, 20), 106.0, 1400.0, 0.0, 1.2))
            else:
                full = float(rng.choice([540.0, 1000.0]))
                engine = rng.uniform(1850, 2050)
                depth = rng.uniform(150, 172)
                phases.append(_Phase("run-up", rng.uniform(6, 14), depth, engine, full, 0.0))
                for _ in range(rng.randint(2, 5)):
                    speed, pto = rng.uniform(1.0, 2.2), full * rng.uniform(0.93, 1.0)
                    length = rng.uniform(50, 90)
                    phases.append(_Phase("harrow", length, depth, engine, pto, speed))
                    turn = rng.uniform(12, 20)
                    phases.append(_Phase("headland", turn, 138.0, 1500.0, 0.75 * pto, 1.2))
    return phases


def working_hour(seed: int = SEED, duration: float = HOUR) -> Work:
    """Return random work, from idling to harrowing, for a time in s."""
    rng = np.random.RandomState(seed)  # whose numbers NumPy promises never to change
    phases = _phases(rng, duration)
    times = np.arange(round(duration * RATE) + 1) / RATE
    ends = np.cumsum([phase.duration for phase in phases])
    which = np.minimum(np.searchsorted(ends, times, side="right"), len(phases) - 1)
    kind = np.array([KINDS.index(phase.kind) for phase in phases])[which]

    def smooth(name: str, seconds: float) -> FloatArray:
        wanted = np.array([getattr(phase, name) for phase in phases])[which]
        return np.asarray(gaussian_filter1d(wanted, seconds * RATE, mode="nearest"))

    def noise(seconds: float) -> FloatArray:
        raw = gaussian_filter1d(rng.standard_normal(len(times)), seconds * RATE)
        return np.asarray(raw / raw.std())

    works = np.isin(kind, [KINDS.index("plough"), KINDS.index("harrow")]).astype(float)
    works = gaussian_filter1d(works, RATE)
    moves = np.clip(smooth("ground", 1.0) / 4.0, 0.0, 1.0)
    angle = smooth("angle", 0.7) + 1.2 * works * noise(0.8) + 0.15 * moves * noise(0.08)
    engine = smooth("engine", 1.0) * (1.0 + 0.015 * works * noise(1.5)) + 3.0 * noise(0.5)
    ratio = smooth("pto", 2.0) * (1.0 + 0.01 * works * noise(1.5))
    speed = smooth("ground", 1.5) * (1.0 + 0.03 * noise(2.0))
    speeds = {
        Source.ENGINE: np.clip(engine, 800.0, 2200.0),
        Source.PTO: np.where(ratio < 5.0, 0.0, np.minimum(ratio, 1000.0)),
        Source.GROUND: np.where(speed < 0.02, 0.0, np.minimum(speed, 11.0)),
    }
    return Work(Run(times, np.radians(np.clip(angle, 91.0, 179.0)), speeds), kind)


def write_bag(path: Path, run: Run) -> None:
    """Write what the sensors of a tractor publish: the joint at 50 Hz and the speeds at 10 Hz."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    joint, header, stamp, number = (
        store.types[name]
        for name in (JOINT_STATE, "std_msgs/msg/Header", "builtin_interfaces/msg/Time", FLOAT64)
    )
    speed_topics = {source: f"/{source.value}_speed" for source in Source}
    topics = {"/joint_states": JOINT_STATE, **dict.fromkeys(speed_topics.values(), FLOAT64)}
    angles = ENCODER_STEP * np.rint(run.angle / ENCODER_STEP)
    nothing = np.empty(0)
    with LogWriter(path, [log_topic(*topic) for topic in topics.items()]) as log:

        def write(topic: str, kind: str, message: Any, time: int) -> None:
            log.write(topic, bytes(store.serialize_cdr(message, kind)), time, time)

        for i in range(0, len(run.times), RATE // JOINT_RATE):
            time = START + i * (10**9 // RATE)
            if i % (RATE // SPEED_RATE) == 0:
                for source, topic in speed_topics.items():
                    step = SPEED_STEPS[source]
                    value = step * round(float(run.speeds[source][i]) / step)
                    write(topic, FLOAT64, number(data=value), time)
            head = header(stamp=stamp(*divmod(time, 10**9)), frame_id="")
            position = np.array([angles[i]])
            message = joint(head, ["hitch_rockshaft_joint"], position, nothing, nothing)
            write("/joint_states", JOINT_STATE, message, time)


def write_excitations(path: Path, machine: str) -> Path:
    """Write the default excitations of a machine of `GROUNDS` or `FAULTS`.

    Those of `FAULTS` lack the ground, which the integration does not contain.
    """
    mapping = yaml.safe_load(config_file(DEFAULT_EXCITATIONS).read_text(encoding="utf-8"))
    if machine in GROUNDS:
        mapping["ground"]["terrain"]["class"] = GROUNDS[machine]
    else:
        del mapping["ground"]
    for name, (kind, amplitude) in FAULTS.get(machine, {}).items():
        mapping[name][kind][0] = amplitude
    path.write_text(yaml.safe_dump(mapping), encoding="utf-8")
    return path


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the node says about some work, beside the forces of the integration.

    Arrays have one value for each message, (n,).
    """

    drive: Drive
    kind: NDArray[np.int64]  # indices of `KINDS`
    ratio: FloatArray  # the largest load ratio of the integration, rms over `WINDOW`, or NaN
    limit: float
    dwell: float  # s

    @property
    def warns(self) -> BoolArray:
        """Where there is a warning."""
        return np.asarray(self.drive.resonances.state == ResonanceState.WARNING)

    @property
    def clearly(self) -> BoolArray:
        """Where the load ratio is clearly above the limit."""
        return np.asarray(self.ratio > CLEARLY * self.limit)

    @property
    def missed(self) -> float:
        """Share of the time clearly above the limit without a warning within a second, 1."""
        return _among(~_widened(self.warns), self.clearly)

    @property
    def needless(self) -> float:
        """Share of the warned time in which half the limit is not reached within a second, 1."""
        far = ~_widened(self.ratio > 0.5 * self.limit)
        return _among(far, self.warns & ~np.isnan(self.ratio))

    def share(self, state: ResonanceState, kind: str = "") -> float:
        """Return the share of the time in a state, of all or of one kind of work, 1."""
        there = self.kind == KINDS.index(kind) if kind else np.ones(len(self.kind), np.bool_)
        return _among(self.drive.resonances.state == state, there)

    def named(self) -> float:
        """Return the share of the messages in warning that name a change that ends it, 1."""
        ends = self.drive.resonances.quiet_speed, self.drive.resonances.quiet_angle
        return _among(np.isfinite(ends[0]) | np.isfinite(ends[1]), self.warns)

    @property
    def lengths(self) -> list[float]:
        """How long each warning lasts, s."""
        return [each.duration for each in episodes(self.drive)]


def outcome(work: Work, machine: str, folder: Path) -> Outcome:
    """Replay some work of a machine, and integrate the forces if it is on even ground."""
    file = write_excitations(folder / "excitations.yaml", machine)
    bag, log = folder / "bag.mcap", folder / "log.mcap"
    if not bag.exists():
        write_bag(bag, work.run)
    settings = Parameters(excitation_file=str(file))
    replay(bag, log, settings)
    drive = read_log(log).drive
    assert drive is not None
    ratio = np.full(len(drive.times), math.nan)
    if machine in FAULTS:
        model = LinkageModel(read_mechanism(config_file(DEFAULT_MECHANISM)))
        reach = float(work.run.angle.min()), float(work.run.angle.max())
        squares = PinForces(model, read_excitations(file), reach).mean_squares(work.run)
        every = np.append(0.0, running(squares, WINDOW))
        rows = np.rint(drive.times / (EVERY * STEP)).astype(int)
        ratio = every[np.minimum(rows, len(every) - 1)]
    kind = work.kind[np.rint(drive.times * RATE).astype(int)]
    return Outcome(drive, kind, ratio, settings.warning_load_ratio, settings.warning_dwell)


def _widened(flags: BoolArray) -> BoolArray:
    """Return where flags are true within a second, at one message each 20 ms."""
    width = 2 * round(1.0 / (EVERY * STEP)) + 1
    return np.asarray(maximum_filter1d(flags.astype(np.uint8), width, mode="constant") > 0)


def _among(flags: BoolArray, there: BoolArray) -> float:
    """Return the share of the places that are there at which flags are true, 1; NaN without any."""
    return float(flags[there].mean()) if there.any() else math.nan


def _percent(share: float) -> str:
    return "-" if math.isnan(share) else f"{100.0 * share:.1f} %"


def _seconds(time: float) -> str:
    return "-" if math.isnan(time) else f"{time:.1f} s"


def states_table(results: dict[str, Outcome]) -> str:
    """Return the shares of warnings and notes by kind of work."""
    rows = []
    for fault, result in results.items():
        for state in (ResonanceState.WARNING, ResonanceState.NOTE):
            shares = [result.share(state), *(result.share(state, kind) for kind in KINDS)]
            rows.append([fault, state.name.lower(), *map(_percent, shares)])
    return table(["machine", "state", "all", *KINDS], rows)


def limits_table(results: dict[str, Outcome]) -> str:
    """Return what is asked of warnings beside what was found."""
    rows = []
    for name, result in results.items():
        healthy = name in GROUNDS or name == EVEN
        warned = result.share(ResonanceState.WARNING) if healthy else math.nan
        shortest = min(result.lengths, default=math.nan)
        checks = (
            (warned, warned > MOST_WARNED),
            (result.missed, result.missed > MOST_MISSED),
            (shortest, shortest < result.dwell - 1e-6),
        )
        cells = [_percent(warned), _percent(result.missed), _seconds(shortest)]
        cells = [
            cell if math.isnan(value) else f"{cell}, {'not met' if above else 'met'}"
            for cell, (value, above) in zip(cells, checks, strict=True)
        ]
        rows.append([name, *cells])
    columns = [
        f"warning, healthy: at most {100.0 * MOST_WARNED:g} %",
        f"missed: at most {100.0 * MOST_MISSED:g} %",
        f"shortest: at least {next(iter(results.values())).dwell:g} s",
    ]
    return table(["machine", *columns], rows)


def episodes_table(results: dict[str, Outcome]) -> str:
    """Return numbers and lengths of warnings, and how they compare with the integration."""
    columns = ["machine", "warnings", "shortest", "median", "longest", "above the limit"]
    columns += [f"above {CLEARLY:g} limits", "missed", "needless", "names a change"]
    rows = []
    for name, result in results.items():
        lengths = result.lengths or [math.nan]
        seconds = [_seconds(float(f(lengths))) for f in (min, np.median, max)]
        known = ~np.isnan(result.ratio)
        above = _among(result.ratio > result.limit, known), _among(result.clearly, known)
        shares = *above, result.missed, result.needless, result.named()
        rows.append([name, str(len(result.lengths)), *seconds, *map(_percent, shares)])
    return table(columns, rows)


def loads_table(result: Outcome) -> str:
    """Return the largest load ratio by each excitation."""
    rows = []
    for part in contributions(result.drive):
        angle = math.degrees(result.drive.angles[part.worst])
        kind = KINDS[result.kind[part.worst]]
        rows.append([part.name, f"{part.load_ratio:.3f}", f"{angle:.0f}", kind])
    return table(["excitation", "largest load ratio", "angle [deg]", "work"], rows)


def draw(results: dict[str, Outcome], picture: Path) -> None:
    """Draw the load ratios over the hour, with the work and the warnings."""
    figure = Figure(figsize=(11.0, 2.2 * len(results) + 1.0), dpi=100, layout="constrained")
    colours = "#cccccc", COLOURS[0], COLOURS[1], COLOURS[2], PEAK, COLOURS[4]
    axes = figure.subplots(len(results), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (fault, result) in zip(axes, results.items(), strict=True):
        minutes = result.drive.times / 60.0
        for k, kind in enumerate(KINDS):
            there = result.kind == k
            axis.fill_between(minutes, 2e-3, 3e-3, where=there, color=colours[k], lw=0, label=kind)
        reported = result.drive.resonances.total_load_ratio
        integrated = np.maximum(result.ratio, 1e-4)
        axis.plot(minutes, integrated, color=COLOURS[3], lw=2.0, label="integrated")
        axis.plot(minutes, reported, color=INK, lw=0.6, label="reported")
        axis.axhline(result.limit, color=INK, ls="--", lw=0.8, label="limit")
        warned = {"color": COLOURS[1], "alpha": 0.3, "lw": 0, "label": "warning"}
        axis.fill_between(minutes, 3e-3, 3.0, where=result.warns, **warned)
        axis.set(yscale="log", ylim=(2e-3, 3.0), xlim=(0.0, minutes[-1]), ylabel="load ratio")
        axis.yaxis.set_major_formatter("{x:g}")
        axis.set_title(fault, loc="left")
    axes[-1].set(xlabel="time [min], with the work in the strip below")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=5)
    figure.savefig(picture)


def main() -> None:
    """Replay the hour with a healthy machine and with faults, and publish how often it warns."""
    work, results = working_hour(), dict[str, Outcome]()
    with tempfile.TemporaryDirectory() as folder:
        for name in (*GROUNDS, *FAULTS):
            results[name] = outcome(work, name, Path(folder))
            (Path(folder) / "log.mcap").unlink()
    publish(
        "working_hour",
        "Warnings in an hour of work",
        [
            "This page shows how often an hour of work warns, and whether the warnings are right. "
            "The hour is random: a tractor idles, drives on the road, ploughs and harrows with "
            "turns at the headland, and starts its PTO. The joint is read at "
            f"{JOINT_RATE} Hz and the speeds at {SPEED_RATE} Hz, in the steps of their sensors. "
            "The excitations are those of `config/excitations.yaml`, whose ground is a road of "
            "class B. The others differ by the class of the ground, or have no ground; then one "
            "fault is added: a cardan shaft that is bent by 10 mm, or a flat spot of a tyre, 10 mm "
            "deep.",
            limits_table(results),
            f"Time above {CLEARLY:g} times the limit of a warning is missed if there is no warning "
            "within a second of it. It is known where the forces were also integrated, which is "
            "without the ground. So it is not known whether warnings by the ground come in time. "
            "These are the shares of the time in each state:",
            states_table(results),
            "The forces in pins and cylinders were integrated over time, from the matrices of "
            "the mechanism alone. A load ratio of the integration is the root mean square over "
            f"{WINDOW:g} s. A warning is needless if half the limit is not reached within a "
            "second. The last column is the share of the warned time in which a message names a "
            "speed or an angle that ends the warning, which one that is only kept does not.",
            episodes_table(results),
            "These are the largest load ratios of the healthy machine on the ground of the file:",
            loads_table(results["healthy"]),
            "![](working_hour.png)",
            "On class D, tyres leave the ground on most of the road. No level of the ground is "
            "known then, which warns, too; the line shows the other excitations there. "
            "The ground is as rough everywhere, also while the tractor ploughs and harrows, "
            "although a tool in the soil carries a part of the load then. "
            "Not contained are soil forces, play and friction.",
        ],
        machine(),
    )
    draw(results, RESULTS / "working_hour.png")


if __name__ == "__main__":
    main()
