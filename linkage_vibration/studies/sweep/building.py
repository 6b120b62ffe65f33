# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Builds the tables of a grid of designs, in any executor, and continues after an interruption.

Each finished design is kept as a part, in a folder beside the output, until all are finished.
"""

import fcntl
import hashlib
import itertools
import json
import shutil
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.studies.sweep.designs import Designs, SweepError
from linkage_vibration.studies.sweep.output import (
    BUILT,
    GIVEN_UP,
    NOT_BUILDABLE,
    Outcome,
    is_complete,
    netcdf,
)
from linkage_vibration.support.atomic_files import write_bytes
from linkage_vibration.table.tabulation import build_table

IN_FLIGHT = 4096  # designs submitted to an executor at a time: enough for a large cluster


@dataclass(frozen=True, slots=True)
class SweepResult:
    """The counts and the messages of a run of a sweep."""

    built: int  # different designs that this run built or tried to build
    kept: int  # designs that an earlier run had finished
    messages: dict[int, str]  # why a design has no result, by its index in the grid
    given_up: int  # designs that the next run tries again


def sweep(
    designs: Designs,
    output: Path,
    executor: Executor,
    progress: Callable[[int], object] = lambda finished: None,
) -> SweepResult:
    """Build every design's table and write them, at common angles, to one netCDF file.

    Finished designs are kept in the folder ``OUTPUT.parts`` until the file is written; after an
    interruption, the next run builds only what is missing there. The executor may be that of a
    cluster, and stays open. `progress` is called with the number of designs finished since the last
    call.
    """
    hashes, outcomes = _model_hashes(designs)
    parts = output.with_name(f"{output.name}.parts")
    with _claimed(parts):
        if is_complete(output, designs.digest(*hashes)):
            progress(designs.size)
            shutil.rmtree(parts)
            return SweepResult(0, designs.size, {}, 0)
        progress(len(outcomes))
        same = _equal_designs(designs, hashes)
        loaded = {part: _load(parts / part) for part in same}
        kept = {part: outcome for part, outcome in loaded.items() if outcome is not None}
        tasks = ((p, designs.mechanism(same[p][0])) for p in same if p not in kept)
        with closing(_build_all(designs, tasks, executor)) as built:
            for part, outcome in itertools.chain(kept.items(), built):
                if part not in kept and outcome.status != GIVEN_UP:
                    write_bytes(parts / part, _packed(outcome), SweepError)
                outcomes.update(dict.fromkeys(same[part], outcome))
                progress(len(same[part]))
        ordered = [outcomes[index] for index in range(designs.size)]
        write_bytes(output, netcdf(designs, hashes, ordered), SweepError)
        messages = {i: outcome.message for i, outcome in enumerate(ordered) if outcome.message}
        given_up = sum(outcome.status == GIVEN_UP for outcome in ordered)
        if not given_up:
            shutil.rmtree(parts)
    return SweepResult(len(same) - len(kept), len(kept), messages, given_up)


def _model_hashes(designs: Designs) -> tuple[list[str], dict[int, Outcome]]:
    """Return every design's hash, and the outcome of those that describe no mechanism."""
    hashes, outcomes = [""] * designs.size, {}
    for index in range(designs.size):
        try:
            hashes[index] = designs.mechanism(index).model_hash
        except LinkageVibrationError as error:
            outcomes[index] = Outcome(NOT_BUILDABLE, str(error))
    return hashes, outcomes


def _equal_designs(designs: Designs, hashes: list[str]) -> dict[str, list[int]]:
    """Return the indices of equal designs, by the name of the part that they share."""
    same: dict[str, list[int]] = {}
    settings = designs.digest()[:16]
    for index, model_hash in enumerate(hashes):
        if model_hash:
            same.setdefault(f"{model_hash}.{settings}", []).append(index)
    return same


def _build(mechanism: Mechanism, alpha3: FloatArray, tolerance: float) -> Outcome:
    """Build a design's table and evaluate it; this runs in a worker."""
    try:
        table = build_table(LinkageModel(mechanism), tolerance, points=())
    except LinkageVibrationError as error:
        return Outcome(NOT_BUILDABLE, str(error))
    low, high = table.alpha3_range
    inside = (alpha3 >= low) & (alpha3 <= high)
    values = np.full((len(alpha3), 2 * table.n_modes + 2), np.nan)
    values[inside] = table.evaluate(alpha3[inside])
    return Outcome(BUILT, "", values, float(np.max(table.interpolation_error)))


def _build_all(
    designs: Designs, tasks: Iterator[tuple[str, Mechanism]], executor: Executor
) -> Generator[tuple[str, Outcome]]:
    """Build designs on an executor, and yield each outcome as soon as it is there."""
    running: dict[Future[Outcome], str] = {}
    done: SimpleQueue[Future[Outcome]] = SimpleQueue()
    try:
        while True:
            for part, mechanism in itertools.islice(tasks, IN_FLIGHT - len(running)):
                future = executor.submit(_build, mechanism, designs.alpha3, designs.tolerance)
                running[future] = part
                future.add_done_callback(done.put)
            if not running:
                return
            future = done.get()
            part = running.pop(future)
            try:
                outcome = future.result()
            except (BrokenExecutor, CancelledError):
                raise
            except Exception as problem:  # of its worker, which ends this design alone
                outcome = Outcome(GIVEN_UP, f"{type(problem).__name__}: {problem}")
            del future  # a cluster rebuilds the results of a dead worker that are still referenced
            yield part, outcome
    except (RuntimeError, CancelledError) as problem:  # it is broken, or was shut down
        raise SweepError(
            f"The executor has ended ({type(problem).__name__}: {problem}). Finished designs are "
            "kept: run the sweep again to continue. (A script that starts processes needs "
            '`if __name__ == "__main__":`.)'
        ) from None
    finally:
        for future in running:
            future.cancel()


@contextmanager
def _claimed(folder: Path) -> Iterator[None]:
    """Make a folder and lock it against other runs; the lock ends with the process."""
    with ExitStack() as stack:
        try:
            folder.mkdir(exist_ok=True)
            lock = stack.enter_context((folder / "lock").open("w"))
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as problem:
            raise SweepError(
                f"{folder}: cannot be written, or another run uses it ({problem.strerror}); let "
                "that run finish, or choose another output."
            ) from None
        yield


def _packed(outcome: Outcome) -> bytes:
    """Return the content of a part: a checksum and a line of JSON, whose numbers are exact."""
    values = None if outcome.values is None else outcome.values.tolist()
    content = [outcome.status, outcome.message, values, outcome.interpolation_error]
    text = json.dumps(content).encode()
    return hashlib.sha256(text).hexdigest().encode() + b"\n" + text


def _load(path: Path) -> Outcome | None:
    """Read a part; return None if it is missing or damaged."""
    try:
        checksum, _, text = path.read_bytes().partition(b"\n")
    except OSError:
        return None
    if hashlib.sha256(text).hexdigest().encode() != checksum:
        return None
    status, message, values, error = json.loads(text)
    return Outcome(status, message, None if values is None else np.array(values), error)
