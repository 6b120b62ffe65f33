# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of many designs, evaluated at the same angles and written to one file.

A sweep is a YAML file: ``mechanism`` (a path beside it), ``parameters`` (the path of each in the
mechanism's description, with its values), ``angles_deg`` and ``tolerance``; every combination of
values is a design. ``config/sweeps/implement.yaml`` shows every key.

Each finished design is kept in a folder beside the output until all are, so that a sweep that was
ended goes on where it stopped.
"""

import fcntl
import hashlib
import io
import itertools
import json
import math
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import netcdf_file

import linkage_vibration
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import Mechanism, MechanismError
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import Keys
from linkage_vibration.readers.mechanism import load_yaml, mechanism_of
from linkage_vibration.studies.yaml_editing import number_at, split_paths, with_numbers
from linkage_vibration.support.atomic_files import write_bytes
from linkage_vibration.support.process_pool import LocalPool
from linkage_vibration.table.tabulation import TOLERANCE, build_table

FloatArray = NDArray[np.float64]

FORMAT = "linkage_vibration sweep 1"
BUILT, NOT_BUILDABLE, GIVEN_UP = 0, 1, 2
IN_FLIGHT = 4096  # designs handed to an executor at a time: enough for a large cluster


class SweepError(LinkageVibrationError):
    """A sweep cannot be read or carried out."""


@dataclass(frozen=True, slots=True, eq=False)
class Designs:
    """A grid of designs, and what to tell of each.

    Attributes
    ----------
    mapping : dict
        The description that they share, as read.
    source : Path
        Where it was read from; files that it names lie beside it.
    paths : tuple of str, (n_parameters,)
        Of the parameters, as `split_paths` takes them.
    values : tuple of tuple of float, (n_parameters,)
        Of each parameter, as in the description; the last one varies fastest.
    alpha3 : ndarray, (n_angles,)
        Angles at which results are told, rad.
    tolerance : float
        Of each table, relative.
    """

    mapping: dict[str, Any]
    source: Path
    paths: tuple[str, ...]
    values: tuple[tuple[float, ...], ...]
    alpha3: FloatArray
    tolerance: float

    @property
    def shape(self) -> tuple[int, ...]:
        """How many values each parameter has."""
        return tuple(len(values) for values in self.values)

    @property
    def size(self) -> int:
        """How many designs there are."""
        return math.prod(self.shape)

    def point(self, index: int) -> tuple[float, ...]:
        """Return the parameters' values of a design."""
        places = np.unravel_index(index, self.shape)
        return tuple(values[i] for values, i in zip(self.values, places, strict=True))

    def name(self, index: int) -> str:
        """Return what tells a design from the others."""
        pairs = zip(self.paths, self.point(index), strict=True)
        return ", ".join(f"{path} = {value:g}" for path, value in pairs)

    def mechanism(self, index: int) -> Mechanism:
        """Return a design.

        Raises
        ------
        MechanismError
            If its values describe no sound mechanism.
        """
        pairs = zip(self.paths, self.point(index), strict=True)
        numbers = [(place, value) for path, value in pairs for place in split_paths(path)]
        return mechanism_of(with_numbers(self.mapping, numbers), self.source)


@dataclass(frozen=True, slots=True)
class SweepResult:
    """What a run of a sweep did.

    Attributes
    ----------
    built : int
        Designs that this run dealt with; equal ones count once.
    kept : int
        Designs that an earlier run had finished.
    messages : dict of int to str
        Why a design has no result, by its place in the grid.
    given_up : int
        How many of those the next run tries again.
    """

    built: int
    kept: int
    messages: dict[int, str]
    given_up: int


@dataclass(frozen=True, slots=True, eq=False)
class _Outcome:
    """What became of a design.

    ``values`` (n_angles, 2 n_modes + 2) are those of `Table.evaluate`, NaN outside the stroke; they
    are missing where ``status`` is not BUILT, and ``message`` tells why.
    """

    status: int
    message: str = ""
    values: FloatArray | None = None
    interpolation_error: float = math.nan


def read_designs(path: Path) -> Designs:
    """Read a sweep and the description that it starts from.

    Raises
    ------
    SweepError
        Naming the file, the key and the mend.
    """
    try:
        asked, _ = load_yaml(path)
        names = tuple(Keys("", asked)["parameters"])
        keys = Keys("", {key: asked[key] for key in asked if key != "parameters"})
        source = path.parent / keys.text("mechanism")
        mapping, _ = load_yaml(source)
        base = mechanism_of(mapping, source)
        values = tuple(_values(asked["parameters"][name], f"parameters.{name}") for name in names)
        alpha3 = np.array([math.radians(a) for a in _linspace(keys["angles_deg"])])
        tolerance = keys.number("tolerance", positive=True, default=TOLERANCE)
        keys.refuse_unknown()
        _check_places(mapping, names)
        if not names:
            raise MechanismError("parameters", "is empty; name one at least.")
        if alpha3.min() < base.stroke[0] or alpha3.max() > base.stroke[1]:
            low, high = (math.degrees(angle) for angle in base.stroke)
            raise MechanismError(
                "angles_deg", f"leaves the stroke of {base.name} ({low:g} to {high:g} deg)."
            )
    except MechanismError as error:
        raise SweepError(f"{path}: {error}") from None
    return Designs(mapping, source, names, values, alpha3, tolerance)


def sweep(
    designs: Designs,
    output: Path,
    executor: Executor | None = None,
    progress: Callable[[int], object] = lambda finished: None,
) -> SweepResult:
    """Build every design's table and write them, at common angles, to one netCDF file.

    What is finished stands in the folder ``OUTPUT.parts`` until the file is written. If a run ends
    early, the next one of the same sweep builds what is missing there, and nothing else.

    Parameters
    ----------
    designs : Designs
        What to build.
    output : Path
        File to write; replaced when it is of another sweep. ``docs/sweep.md`` tells what it holds.
    executor : Executor, optional
        Where to build, such as a Dask client's ``get_executor()``; it stays open. A `LocalPool`
        unless given.
    progress : callable
        Called with the number of designs that have been finished since the last call.

    Raises
    ------
    SweepError
        If a file cannot be written, another run is at work on this output, or the executor ends.
    """
    hashes, outcomes = [], {}
    for index in range(designs.size):
        try:
            hashes.append(designs.mechanism(index).model_hash)
        except LinkageVibrationError as error:
            hashes.append("")
            outcomes[index] = _Outcome(NOT_BUILDABLE, str(error))
    parts = output.with_name(f"{output.name}.parts")
    with _claimed(parts):
        earlier = _finished(output, _digest(designs, *hashes))
        if earlier is not None:
            progress(designs.size)
            shutil.rmtree(parts)
            return earlier
        same: dict[str, list[int]] = {}  # by the name of their part
        settings = _digest(designs)[:16]
        for index, model_hash in enumerate(hashes):
            if index not in outcomes:
                same.setdefault(f"{model_hash}.{settings}", []).append(index)
        progress(len(outcomes))
        missing = []
        for part, indices in same.items():
            outcome = _load(parts / part, len(designs.alpha3))
            if outcome is None:
                missing.append(part)
            else:
                outcomes.update(dict.fromkeys(indices, outcome))
                progress(len(indices))

        def finished(part: str, outcome: _Outcome) -> None:
            if outcome.status != GIVEN_UP:
                write_bytes(parts / part, _packed(outcome), SweepError)
            outcomes.update(dict.fromkeys(same[part], outcome))
            progress(len(same[part]))

        tasks = ((part, designs.mechanism(same[part][0])) for part in missing)
        with LocalPool() if executor is None else nullcontext(executor) as pool:
            _build_all(designs, tasks, pool, finished)
        ordered = [outcomes[index] for index in range(designs.size)]
        write_bytes(output, _netcdf(designs, hashes, ordered), SweepError)
        messages = {i: outcome.message for i, outcome in enumerate(ordered) if outcome.message}
        given_up = sum(outcome.status == GIVEN_UP for outcome in ordered)
        if not given_up:
            shutil.rmtree(parts)
    return SweepResult(len(missing), len(same) - len(missing), messages, given_up)


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """Connect to a Dask cluster while it is used.

    Parameters
    ----------
    address : str
        Of its scheduler, such as ``tcp://host:8786``. The workers need this package too.

    Raises
    ------
    SweepError
        If Dask is not installed, or no scheduler answers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise SweepError("Dask is missing; `pip install linkage_vibration[dask]`.") from None
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as problem:
        raise SweepError(f"{address}: no Dask scheduler answers there ({problem}).") from None
    with client:
        yield client.get_executor()


def _build(mechanism: Mechanism, alpha3: FloatArray, tolerance: float) -> _Outcome:
    """Build a design's table and evaluate it; this is what runs in a worker."""
    try:
        table = build_table(LinkageModel(mechanism), tolerance, points=())
    except LinkageVibrationError as error:
        return _Outcome(NOT_BUILDABLE, str(error))
    low, high = table.alpha3_range
    inside = (alpha3 >= low) & (alpha3 <= high)
    values = np.full((len(alpha3), 2 * table.n_modes + 2), np.nan)
    values[inside] = table.evaluate(alpha3[inside])
    return _Outcome(BUILT, "", values, float(np.max(table.interpolation_error)))


def _build_all(
    designs: Designs,
    tasks: Iterator[tuple[str, Mechanism]],
    executor: Executor,
    finished: Callable[[str, _Outcome], None],
) -> None:
    """Build designs on an executor, and hand each one's outcome on as soon as it is there."""
    running: dict[Future[_Outcome], str] = {}
    done: SimpleQueue[Future[_Outcome]] = SimpleQueue()
    try:
        while True:
            for part, mechanism in itertools.islice(tasks, IN_FLIGHT - len(running)):
                try:
                    future = executor.submit(_build, mechanism, designs.alpha3, designs.tolerance)
                except RuntimeError as problem:  # it was shut down
                    raise BrokenExecutor(str(problem)) from None
                running[future] = part
                future.add_done_callback(done.put)
            if not running:
                return
            future = done.get()
            part, outcome = running.pop(future), _outcome(future)
            del future  # a cluster builds again what is still held when its worker dies
            finished(part, outcome)
    except (BrokenExecutor, CancelledError) as problem:
        raise SweepError(
            f"The executor has ended ({type(problem).__name__}: {problem}); what is finished is "
            'kept: run the sweep again to go on. (A script needs `if __name__ == "__main__":`.)'
        ) from None
    finally:
        for future in running:
            future.cancel()


def _outcome(future: Future[_Outcome]) -> _Outcome:
    """Return what a worker made of a design; whatever it raises ends that design alone."""
    try:
        return future.result()
    except (BrokenExecutor, CancelledError):
        raise
    except LinkageVibrationError as problem:
        return _Outcome(GIVEN_UP, str(problem))
    except Exception as problem:
        return _Outcome(GIVEN_UP, f"{type(problem).__name__}: {problem}")


@contextmanager
def _claimed(folder: Path) -> Iterator[None]:
    """Make a folder and keep other runs out of it; a lock goes when its process does."""
    try:
        folder.mkdir(exist_ok=True)
        lock = (folder / "lock").open("w")
    except OSError as problem:
        raise SweepError(
            f"{folder}: cannot be written ({problem.strerror}); choose another output."
        ) from None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as problem:
            raise SweepError(
                f"{folder}: is in use by another run ({problem.strerror}); let it finish, or "
                "choose another output."
            ) from None
        yield


def _digest(designs: Designs, *hashes: str) -> str:
    """Name what results depend on."""
    version = linkage_vibration.__version__
    content = [FORMAT, version, hashes, designs.alpha3.tolist(), designs.tolerance]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def _packed(outcome: _Outcome) -> bytes:
    """Return a part: a checksum, a line of JSON and the values."""
    head = [outcome.status, outcome.message, outcome.interpolation_error]
    values = b"" if outcome.values is None else outcome.values.astype("<f8").tobytes()
    content = json.dumps(head).encode() + b"\n" + values
    return hashlib.sha256(content).digest() + content


def _load(path: Path, n_angles: int) -> _Outcome | None:
    """Read a part; None where there is none or it is damaged."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    if hashlib.sha256(data[32:]).digest() != data[:32]:
        return None
    head, _, numbers = data[32:].partition(b"\n")
    status, message, error = json.loads(head)
    values = np.frombuffer(numbers, "<f8").reshape(n_angles, -1) if numbers else None
    return _Outcome(status, message, values, error)


def _finished(output: Path, digest: str) -> SweepResult | None:
    """Return what an output tells, if it is of the same sweep and nothing was given up in it."""
    try:
        with netcdf_file(output, mmap=False) as file:
            same = getattr(file, "digest", b"") == digest.encode()
            if not same or (file.variables["status"][:] == GIVEN_UP).any():
                return None
            text = file.variables["message"][:]
    except (OSError, TypeError, ValueError, KeyError):
        return None  # to be written anew
    messages = text.reshape(-1, text.shape[-1]).view(f"S{text.shape[-1]}")[:, 0]
    told = {i: message.decode() for i, message in enumerate(messages) if message}
    return SweepResult(0, len(messages), told, 0)


def _netcdf(designs: Designs, hashes: Iterable[str], outcomes: list[_Outcome]) -> bytes:
    """Return the one file of a sweep; every byte of it follows from its designs."""
    hashes = list(hashes)
    n_modes = designs.mapping["response"]["modes"]
    values = np.full((len(outcomes), len(designs.alpha3), 2 * n_modes + 2), np.nan)
    for own, outcome in zip(values, outcomes, strict=True):
        if outcome.values is not None:
            own[:] = outcome.values
    content = io.BytesIO()
    file = netcdf_file(content, "w", version=2)
    file.title = "Natural frequencies and FRF peaks over a grid of designs"
    file.source = f"linkage_vibration {linkage_vibration.__version__}"
    file.mechanism = json.dumps(designs.mapping, default=str)
    file.digest = _digest(designs, *hashes)
    file.tolerance = designs.tolerance

    def add(name: str, dims: tuple[str, ...], array: NDArray[Any], **attributes: Any) -> None:
        for dim, length in zip(dims, array.shape, strict=True):
            if dim not in file.dimensions:
                file.createDimension(dim, length)
        variable = file.createVariable(name, array.dtype.newbyteorder(">"), dims)
        variable[:] = array
        for attribute, value in attributes.items():
            setattr(variable, attribute, value)

    def add_result(
        name: str, dims: tuple[str, ...], array: NDArray[Any], **attributes: Any
    ) -> None:
        shaped = array.reshape(designs.shape + array.shape[1:])
        add(name, designs.paths + dims, shaped, **attributes)

    def add_text(name: str, texts: Iterable[str], told: str) -> None:
        rows = [text.encode() for text in texts]
        length = max(1, *map(len, rows))
        letters = np.array(rows, dtype=f"S{length}").view("S1").reshape(-1, length)
        add_result(name, (f"{name}_length",), letters, long_name=told, _Encoding="utf-8")

    for path, numbers in zip(designs.paths, designs.values, strict=True):
        add(path, (path,), np.array(numbers, dtype=float), units=_units(path))
    add("alpha3", ("alpha3",), designs.alpha3, units="rad", long_name="angle of the input crank")
    modes = np.arange(1, n_modes + 1, dtype=np.int32)
    add("mode", ("mode",), modes, long_name="as numbered, then tracked, in each table")
    curves, angle = ("alpha3", "mode"), ("alpha3",)
    add_result("natural_frequencies", curves, values[:, :, :n_modes], units="Hz")
    add_result("damping_ratios", curves, values[:, :, n_modes:-2], units="1")
    add_result("frf_peak_frequency", angle, values[:, :, -2], units="Hz")
    add_result("frf_peak_magnitude", angle, values[:, :, -1], units="m/N")
    errors = np.array([outcome.interpolation_error for outcome in outcomes])
    add_result("interpolation_error", (), errors, units="1", long_name="worst, of the table")
    add_result(
        "status",
        (),
        np.array([outcome.status for outcome in outcomes], dtype=np.int8),
        flag_values=np.array([BUILT, NOT_BUILDABLE, GIVEN_UP], dtype=np.int8),
        flag_meanings="built not_buildable given_up",
    )
    add_text("message", [outcome.message for outcome in outcomes], "why there is no result")
    add_text("model_hash", hashes, "of the design")
    file.flush()
    return content.getvalue()


def _units(path: str) -> str:
    """Return the unit of a parameter, as far as its path tells."""
    keys = split_paths(path)[0].split(".")
    if any(key.endswith("_deg") for key in keys):
        return "degree"
    return "Hz" if any(key.endswith("_hz") for key in keys) else "SI"


def _values(value: Any, path: str) -> tuple[float, ...]:
    """Read the values of a parameter: a list, or from, to and points."""
    if isinstance(value, Mapping):
        keys = Keys(path, value)
        numbers = _linspace(keys)
        keys.refuse_unknown()
    elif isinstance(value, list) and value:
        places = Keys(path, {str(i): number for i, number in enumerate(value)})
        for i in places:
            places.number(i)
        numbers = value  # whole numbers stay so: a count of links is one
    else:
        raise MechanismError(
            path, f"{value!r} is no list of values; give some, or {{from: , to: , points: }}."
        )
    if len(set(numbers)) < len(numbers):
        raise MechanismError(path, "a value stands twice; name each once.")
    return tuple(numbers)


def _linspace(keys: Keys) -> list[float]:
    ends = keys.number("from"), keys.number("to")
    return [float(x) for x in np.linspace(*ends, keys.integer("points"))]


def _check_places(mapping: dict[str, Any], paths: tuple[str, ...]) -> None:
    """Refuse places that hold no number, and two parameters that are one number."""
    for place in (place for path in paths for place in split_paths(path)):
        number_at(mapping, place)
        if place == "response.modes":
            raise MechanismError(
                f"parameters.{place}", "all designs have as many modes; set it in the mechanism."
            )
    marks = [(place, float(i)) for i, path in enumerate(paths) for place in split_paths(path)]
    marked = with_numbers(mapping, marks)
    for place, mark in marks:
        if number_at(marked, place) != mark:
            raise MechanismError(
                f"parameters.{place}",
                "another parameter is the same number, perhaps by an alias; name one of them.",
            )
