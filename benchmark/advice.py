# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares the probabilities of advice with whole models whose numbers are drawn."""

import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from benchmark.ensemble import Scene, model_squares, models, scenes
from benchmark.report import machine, publish, table
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.advice import KMH, NOW, Question, advise
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.mechanism import mechanism_of
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation import build_table
from test.support.in_plane import IN_PLANE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

NAMES = "tractor", "loader"
MODELS, PARTS = 1000, 40
HEIGHTS, SPEEDS = 10, 9
SPEEDS_KMH = 10.0, 50.0
DRIVES = (1800.0, math.nan), (2100.0, math.nan), (1500.0, 540.0), (2000.0, 1000.0)  # rpm
KINDS = "orders", "ground", "both"
PLACES = "height", "speed", "both"
BINS = (0.5, 0.75), (0.75, 0.9), (0.9, 0.93), (0.93, 0.97), (0.97, 1.0)
SURE = BINS[3]  # Where a probability of 95 % is stated.
MEMBERS, NOTABLE = 64, 0.8
BATCHES = 20  # of models, whose scatter is the error of a share


def drives(scene: Scene) -> Scene:
    """Return a scene with all heights, drives and ground speeds, in this order of axes."""
    low, high = (math.radians(x) for x in scene.mapping["input"]["range_deg"])
    ground = np.linspace(*SPEEDS_KMH, SPEEDS) / KMH
    heights = np.linspace(low, high, HEIGHTS)
    at = np.meshgrid(heights, np.arange(len(DRIVES)), ground, indexing="ij")
    alpha3, drive, speed = (each.astype(float).ravel() for each in at)
    speeds = np.vstack([np.array(DRIVES)[drive.astype(int)].T, speed])
    return replace(scene, alpha3=alpha3, speeds=speeds)


def sampled(scene: Scene, built: Table, count: int, seed: int) -> FloatArray:
    """Return total load ratios of whole models, (count, n_kinds, n); NaN if not possible."""
    terrain = np.array([each.terrain is not None for each in scene.excitations])
    values = np.full((count, len(KINDS), len(scene.alpha3)), math.nan)
    for row, each in zip(values, models(scene, count, seed), strict=True):
        if each is None:
            continue
        try:
            squares = model_squares(each[0], scene, built, *each[1:])[1:]
        except LinkageVibrationError:
            continue
        for kind, which in enumerate((~terrain, terrain, terrain | True)):
            row[kind] = np.sqrt(np.nansum(squares[:, which], axis=1).max(axis=0))
    return values


@dataclass(frozen=True)
class Pairs:
    """Pairs of heights and speeds, of which one is quieter for most members of an ensemble."""

    what: IntArray  # (n,), index of `PLACES`
    stated: FloatArray  # (n,), 1: the probability, at least 1/2
    true: FloatArray  # (n_batches, n), 1: the shares of the models

    def coverage(self, low: float, high: float, what: int | None = None) -> tuple[int, FloatArray]:
        """Return how many pairs have such a stated probability, its mean, the true one, its error.

        The error is the standard one by the number of models.
        """
        which = (self.stated >= low) & (self.stated < high)
        which &= (self.what == what) | (what is None)
        true = self.true[:, which].mean(axis=1)
        error = true.std(ddof=1) / math.sqrt(len(true))
        return int(which.sum()), np.array([self.stated[which].mean(), true.mean(), error])


def pairs(members: FloatArray, true: FloatArray, known: BoolArray) -> Pairs:
    """Compare all pairs of cells of a map at one drive.

    Parameters
    ----------
    members, true : ndarray, (n_members, n_cells) and (n_models, n_cells)
        Total load ratios.
    known : ndarray of bool, (n_cells,)
    """
    now, other = (np.flatnonzero(known)[i] for i in np.triu_indices(known.sum(), 1))
    height, speed = (
        each == two for each, two in zip(divmod(now, SPEEDS), divmod(other, SPEEDS), strict=True)
    )
    what = np.where(speed, 0, np.where(height, 1, 2))
    quieter = (members[:, other] < members[:, now]).sum(axis=0)
    stated = (quieter + 0.5) / (len(members) + 1.0)
    shares = np.array(
        [
            (part[:, other] < part[:, now]).mean(axis=0)
            for part in np.array_split(true, min(BATCHES, len(true)))
        ]
    )
    turned = stated < 0.5
    return Pairs(
        what, np.where(turned, 1.0 - stated, stated), np.where(turned, 1.0 - shares, shares)
    )


@dataclass(frozen=True)
class Choices:
    """What is advised instead of some heights and speeds, n times, and what whole models say."""

    what: IntArray  # (n,), index of `PLACES`
    share: FloatArray  # (n,), load that is left, 1
    quieter: FloatArray  # (n_models, n), 1 or 0
    regrets: FloatArray  # (n_models, n), 1


def choices(
    levels: LevelTable, excitations: Sequence[Excitation], at: Scene, true: FloatArray
) -> Choices:
    """Ask for advice at some heights and speeds of each drive, and look what models say.

    Parameters
    ----------
    levels, excitations, at
        The levels of a table, its excitations, and all heights, drives and speeds.
    true : ndarray, (n_models, n_heights, n_drives, n_speeds)
        Total load ratios of the models.
    """
    alpha3 = at.alpha3.reshape(HEIGHTS, -1, SPEEDS)
    speeds = at.speeds.reshape(len(at.speeds), HEIGHTS, -1, SPEEDS)
    heights, ground = alpha3[:, 0, 0], speeds[-1, 0, 0]
    ends = (heights[0], heights[-1]), (ground[0], ground[-1])
    rows: list[tuple[Any, ...]] = []
    for i, drive, j in np.ndindex(true.shape[1:]):
        if i % 3 or j % 2:
            continue
        question = Question(float(heights[i]), speeds[:, i, drive, j], *ends)
        advised = advise(levels, excitations, question, (HEIGHTS, SPEEDS))
        loads, now = true[:, :, drive], true[:, i, drive, j]
        permitted = np.where(advised.reasons, math.nan, loads)
        among = permitted[:, :, [j]], permitted[:, [i]], permitted
        message = advised.message
        for what, cells in enumerate(among):
            place = what + 1
            ratio = float(message.load_ratios[place] / message.load_ratios[NOW])
            if not math.isfinite(ratio):
                continue
            row = int(np.abs(heights - message.crank_angles[place]).argmin())
            column = int(np.abs(ground - message.ground_speeds[place]).argmin())
            chosen = loads[:, row, column]
            regret = chosen / np.nanmin(cells, axis=(1, 2)) - 1.0
            rows.append((what, ratio, chosen < now, regret))
    which, share, quieter, regrets = map(np.array, zip(*rows, strict=True))
    return Choices(which, share, quieter.T, regrets.T)


def stacked(parts: Sequence[Pairs]) -> Pairs:
    """Return all pairs of several drives."""
    return Pairs(
        np.concatenate([part.what for part in parts]),
        np.concatenate([part.stated for part in parts]),
        np.concatenate([part.true for part in parts], axis=1),
    )


def at_random(true: FloatArray, known: BoolArray, size: int) -> FloatArray:
    """Return how often a stated 95 % holds if models at random are the ensemble, (n_ensembles,).

    Each has so many of the models, and is compared with all others.
    """
    result = []
    for first in range(0, len(true) - size + 1, size):
        chosen = np.s_[first : first + size]
        rest = np.delete(true, chosen, axis=0)
        parts = [pairs(true[chosen, d], rest[:, d], known[d]) for d in range(true.shape[1])]
        result.append(stacked(parts).coverage(*SURE)[1][1])
    return np.array(result)


def compared(name: str, at: Scene, built: Table, loads: FloatArray) -> list[list[list[str]]]:
    """Return the rows of the tables of the page for a scene, from the loads of `sampled`."""
    mechanism = mechanism_of(at.mapping, Path("description"))
    loads = loads[np.isfinite(loads).all(axis=(1, 2))]
    shape = HEIGHTS, len(DRIVES), SPEEDS
    sure, bins, regrets = [], [], []
    for kind, drawn in zip(KINDS, loads.swapaxes(0, 1), strict=True):
        wanted = [True, False] if kind == "both" else [kind == "ground"]
        excitations = [each for each in at.excitations if (each.terrain is not None) in wanted]
        levels = LevelTable(Predictor(built), mechanism, excitations)
        members, _ = levels.member_totals(at.alpha3, at.speeds)
        values = levels.at(at.alpha3, at.speeds)
        known = np.isfinite(values.total_load_ratio) & (values.ground_unknown == "")
        # The ground alone does not depend on the speeds of engine and PTO.
        used = slice(1 if kind == "ground" else len(DRIVES))
        stated, true = (
            np.moveaxis(each.reshape(-1, *shape), 2, 1)[:, used].reshape(
                len(each), -1, HEIGHTS * SPEEDS
            )
            for each in (members, drawn)
        )
        known = np.moveaxis(known.reshape(shape), 1, 0)[used].reshape(-1, HEIGHTS * SPEEDS)
        every = stacked([pairs(stated[:, d], true[:, d], each) for d, each in enumerate(known)])
        columns = [every.coverage(*SURE, what) for what in range(len(PLACES))]
        columns.append(every.coverage(*SURE))
        random = at_random(true, known, MEMBERS)
        first = [name, kind]
        sure.append([*first, *map(percent, columns)])
        sure[-1].append(f"{100.0 * random.mean():.1f} ± {100.0 * random.std():.1f}")
        bins.append([*first, *(percent(every.coverage(*each)) for each in BINS)])
        drives = true.reshape(len(true), -1, HEIGHTS, SPEEDS).swapaxes(1, 2)
        made = choices(levels, excitations, at, drives)
        for what, place in enumerate(PLACES):
            which = made.what == what
            named = which & (made.share <= NOTABLE)
            low, high = 100.0 * np.quantile(made.regrets[:, which], [0.5, 0.95])
            regrets.append([*first, place, f"{low:.1f}", f"{high:.0f}", str(int(named.sum()))])
            regrets[-1] += [f"{100.0 * made.quieter[:, named].mean():.1f}" if named.any() else ""]
    return [sure, bins, regrets]


def page(rows: list[list[list[str]]], lost: Sequence[str]) -> list[str]:
    """Return the paragraphs and tables of the page."""
    kind = ["description", "excitations"]
    return [
        f"This page compares what [advice](../../docs/advice.md) states with {MODELS} whole models "
        "of each description, whose uncertain numbers and amplitudes are drawn at random, and "
        "which are described, closed, reduced and solved without a table. Their loads by the "
        "ground are integrals over their own responses. The map has "
        f"{HEIGHTS} heights over the stroke and {SPEEDS} speeds of 10 to 50 km/h, at "
        f"{len(DRIVES)} speeds of engine and PTO. The excitations are in "
        "`config/excitations.yaml` and `benchmark/ensemble.py`: their orders alone, the ground "
        f"alone, and both. Models that are not possible do not count: {', '.join(lost)}.",
        IN_PLANE,
        "Of all pairs of cells that differ in height, in speed, or in both, this table has those "
        "of which advice states with 93 to 97 % that one is quieter. Each entry is the mean of "
        "what is stated, the share of the models in which that cell is quieter, its standard error "
        "by the number of the models (%), and the number of pairs. In the last column, "
        f"{MEMBERS} of the random models replace the ensemble of the table, again and again, and "
        "the others are the truth: mean and standard deviation of their share. By so much, "
        "ensembles of this size differ.",
        table([*kind, *PLACES, "all", "members at random"], rows[0]),
        "The same of all pairs, by what is stated:",
        table(
            [*kind, *(f"{100.0 * low:.0f} to {100.0 * high:.0f} %" for low, high in BINS)], rows[1]
        ),
        "What is advised at each third height and each second speed: the regret in the median and "
        "the worst twentieth of all models (%), by how much the load there is above that of the "
        "best cell for this model. Where at most "
        f"{100.0 * NOTABLE:.0f} % of the load is left, a sentence names the place: how often, and "
        "the share of the models in which it is quieter (%).",
        table([*kind, "advised", "median", "95 %", "named", "quieter"], rows[2]),
    ]


def percent(coverage: tuple[int, FloatArray]) -> str:
    """Return what `Pairs.coverage` returned, in per cent."""
    count, (stated, true, error) = coverage[0], 100.0 * coverage[1]
    return f"{stated:.1f}: {true:.1f} ± {error:.1f} ({count})" if count else ""


def main() -> None:
    """Draw models of each scene, and publish how what is stated compares."""
    rows: list[list[list[str]]] = [[], [], []]
    lost = []
    with tqdm(desc="models", total=MODELS * len(NAMES)) as bar, ProcessPoolExecutor() as pool:
        for name in NAMES:
            at = drives(scenes()[name])
            mechanism = mechanism_of(at.mapping, Path("description"))
            built = build_table(LinkageModel(mechanism))
            count = MODELS // PARTS
            waiting = [pool.submit(sampled, at, built, count, seed) for seed in range(PARTS)]
            for _ in as_completed(waiting):
                bar.update(count)
            loads = np.concatenate([each.result() for each in waiting])
            lost.append(f"{int(np.isnan(loads).any(axis=(1, 2)).sum())} of the {name}")
            for part, item in zip(rows, compared(name, at, built, loads), strict=True):
                part.extend(item)
    publish("advice", "How sure advice is", [*page(rows, lost)], machine())


if __name__ == "__main__":
    main()
