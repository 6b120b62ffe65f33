# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a log tells of a drive: predictions with what belongs to them, and what made them."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from mcap.exceptions import McapError
from mcap.reader import make_reader
from numpy.typing import NDArray

from linkage_vibration.bags.message_columns import (
    LOG_TIME,
    Columns,
    first_topic,
    header_stamps,
    read_columns,
    topic_types,
)
from linkage_vibration.drawing.intervals import gap_starts
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.messages.provenance import EXCITATIONS, PARAMETERS
from linkage_vibration.messages.topics import PREDICTION, RESONANCE, SPEEDS
from linkage_vibration.prediction.excitation import Excitation, Source, excitations_from_mapping
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.atomic_files import write_text
from linkage_vibration.table.table import Table, TableError, load_table

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class ReviewError(LinkageVibrationError):
    """A log cannot be reviewed, or two cannot be compared."""


@dataclass(frozen=True, slots=True, eq=False)
class Resonances:
    """The nearest excitation at each prediction; NaN, 0 and "" where the log has none.

    Attributes
    ----------
    state, mode, approach : ndarray of int, (n,)
        As in the message; a prediction without a resonance is stale.
    excitation : ndarray of str, (n,)
        Names.
    excitation_frequency, natural_frequency, margin : ndarray, (n,)
        Hz.
    relative_margin : ndarray, (n,)
        1.
    time_to_crossing : ndarray, (n,)
        s.
    """

    state: IntArray
    excitation: NDArray[np.str_]
    excitation_frequency: FloatArray
    mode: IntArray
    natural_frequency: FloatArray
    margin: FloatArray
    relative_margin: FloatArray
    approach: IntArray
    time_to_crossing: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """A log of predictions, in order of their stamps.

    Attributes
    ----------
    path : Path
        The file.
    stamps : ndarray of int, (n,)
        ns.
    status : ndarray of int, (n,)
        As in the message.
    crank_angle : ndarray, (n,)
        rad.
    natural_frequencies, frequency_stddev, damping_ratios : ndarray, (n, n_modes)
        Hz, Hz (NaN where the log is older than they are) and 1.
    peak_frequency, peak_magnitude : ndarray, (n,)
        Of the FRF, Hz and m/N.
    interpolation_error : ndarray, (n,)
        1.
    resonances : Resonances or None
        None where the log has none at all.
    speeds : dict of Source to (times, values)
        Speeds on topics: s since the first stamp, and rpm or m/s. As they have no stamps, they
        stand where they were received, less the predictions' own delay.
    excitations : tuple of Excitation
        All that were watched; empty where the log does not tell.
    table : Table or None
        That made the predictions, if the log holds it.
    table_id : str
        Its name.
    mechanism : Mechanism or None
        That the table was built from, if the log holds it.
    mechanism_text : str
        The same as YAML; empty without.
    parameters : dict of str
        Of what made the log.
    parameters_text : str
        The same as YAML; empty without.
    metadata : dict of str to dict of str to str
        The log's metadata records by their names.
    """

    path: Path
    stamps: IntArray
    status: IntArray
    crank_angle: FloatArray
    natural_frequencies: FloatArray
    frequency_stddev: FloatArray
    damping_ratios: FloatArray
    peak_frequency: FloatArray
    peak_magnitude: FloatArray
    interpolation_error: FloatArray
    resonances: Resonances | None
    speeds: dict[Source, tuple[FloatArray, FloatArray]]
    excitations: tuple[Excitation, ...]
    table: Table | None
    table_id: str
    mechanism: Mechanism | None
    mechanism_text: str
    parameters: dict[str, object]
    parameters_text: str
    metadata: dict[str, dict[str, str]]

    @property
    def n_modes(self) -> int:
        """How many modes are predicted."""
        return int(self.natural_frequencies.shape[1])

    @property
    def times(self) -> FloatArray:
        """Seconds since the first stamp, (n,)."""
        return np.asarray((self.stamps - self.stamps[0]) / 1e9)


def read_log(path: str | Path) -> Log:
    """Read a log.

    Parameters
    ----------
    path : str or Path
        An MCAP, as the node or a replay writes it.

    Raises
    ------
    BagError
        If it cannot be read.
    ReviewError
        If it holds no prediction.
    """
    path = Path(path)
    types = topic_types(path)
    predictions, resonances = first_topic(types, PREDICTION), first_topic(types, RESONANCE)
    speeds = {
        topic: source
        for name, source in SPEEDS.items()
        for topic, kind in types.items()
        if topic.endswith(f"/{name}") and kind == "std_msgs/msg/Float64"
    }
    wanted = [predictions, resonances, *speeds]
    columns = read_columns(path, {topic: types[topic] for topic in wanted if topic})
    told = columns[predictions] if predictions else {}
    if not predictions or not len(told["crank_angle"]):
        raise ReviewError(f"{path} holds no prediction; was the joint ever published?")
    stamps = header_stamps(told)
    order = np.argsort(stamps, kind="stable")
    stamps, told = stamps[order], {name: column[order] for name, column in told.items()}
    start = stamps[0] + int(np.median(told[LOG_TIME] - stamps))
    n_modes = told["natural_frequencies"].shape[1]
    table_id = str(told["table_id"][-1])
    attachments, metadata = _read_provenance(path)
    table, mechanism, mechanism_text = _read_model(attachments, table_id)
    parameters_text = attachments.get(PARAMETERS, b"").decode(errors="replace")
    return Log(
        path=path,
        stamps=stamps,
        status=told["status"].astype(np.int64),
        crank_angle=told["crank_angle"],
        natural_frequencies=told["natural_frequencies"],
        frequency_stddev=told.get("frequency_stddev", np.full((len(stamps), n_modes), np.nan)),
        damping_ratios=told["damping_ratios"],
        peak_frequency=told["frf_peak_frequency"],
        peak_magnitude=told["frf_peak_magnitude"],
        interpolation_error=told["interpolation_error"],
        resonances=_resonances(columns[resonances], stamps) if resonances else None,
        speeds={
            source: ((columns[topic][LOG_TIME] - start) / 1e9, columns[topic]["data"])
            for topic, source in speeds.items()
            if len(columns[topic]["data"])
        },
        excitations=_excitations(attachments),
        table=table,
        table_id=table_id,
        mechanism=mechanism,
        mechanism_text=mechanism_text,
        parameters=_parameters(parameters_text),
        parameters_text=parameters_text,
        metadata=metadata,
    )


def gaps(log: Log) -> list[tuple[float, float]]:
    """Return where predictions are missing: from and until when, s since the first stamp."""
    times = log.times.tolist()
    return [(times[i], times[i + 1]) for i in gap_starts(log.times).tolist()]


def durations(log: Log) -> FloatArray:
    """Return for how long each prediction held, s, (n,): until the next, or the gap before it."""
    steps = np.diff(log.times)
    if len(steps):
        steps[gap_starts(log.times)] = np.median(steps)
    return np.append(steps, 0.0)


def csv_text(log: Log) -> str:
    """Return every prediction of a log as a line of CSV, in SI units and radians, NaN as "nan"."""
    names = ["stamp_ns", "status", "crank_angle_rad"]
    columns: list[NDArray[np.generic]] = [log.stamps, log.status, log.crank_angle]
    for name, values in (
        ("natural_frequency_{}_hz", log.natural_frequencies),
        ("frequency_stddev_{}_hz", log.frequency_stddev),
        ("damping_ratio_{}", log.damping_ratios),
    ):
        names += [name.format(mode + 1) for mode in range(log.n_modes)]
        columns += list(values.T)
    names += ["frf_peak_frequency_hz", "frf_peak_magnitude_m_per_n", "interpolation_error"]
    columns += [log.peak_frequency, log.peak_magnitude, log.interpolation_error]
    if log.resonances is not None:
        r = log.resonances
        names += ["resonance_state", "excitation", "excitation_frequency_hz", "mode"]
        columns += [r.state, r.excitation, r.excitation_frequency, r.mode + 1]
        names += ["margin_hz", "relative_margin", "approach", "time_to_crossing_s"]
        columns += [r.margin, r.relative_margin, r.approach, r.time_to_crossing]
    lines = [",".join(names)]
    # str of a Python float is the shortest text that gives the same float again.
    lines += [",".join(map(str, row)) for row in zip(*(c.tolist() for c in columns), strict=True)]
    return "\n".join(lines) + "\n"


def write_csv(log: Log, path: Path) -> None:
    """Write `csv_text` to a file, beside and renamed.

    Raises
    ------
    ReviewError
        If it cannot be written.
    """
    write_text(path, csv_text(log), ReviewError)


def _resonances(columns: Columns, stamps: IntArray) -> Resonances | None:
    """Put resonances beside the predictions of the same stamps."""
    own = header_stamps(columns)
    if not len(own):
        return None
    order = np.argsort(own, kind="stable")
    own = own[order]
    at = np.minimum(np.searchsorted(own, stamps), len(own) - 1)
    found = own[at] == stamps
    rows = order[at]

    def numbers(name: str) -> FloatArray:
        return np.where(found, columns[name][rows], np.nan)

    def whole(name: str, missing: int = 0) -> IntArray:
        return np.where(found, columns[name][rows].astype(np.int64), missing)

    return Resonances(
        state=whole("state", missing=2),
        excitation=np.where(found, columns["excitation"][rows], ""),
        excitation_frequency=numbers("excitation_frequency"),
        mode=whole("mode"),
        natural_frequency=numbers("natural_frequency"),
        margin=numbers("margin"),
        relative_margin=numbers("relative_margin"),
        approach=whole("approach"),
        time_to_crossing=numbers("time_to_crossing"),
    )


def _read_provenance(path: Path) -> tuple[dict[str, bytes], dict[str, dict[str, str]]]:
    """Return a log's attachments and its metadata records, by their names."""
    try:
        with path.open("rb") as file:
            reader = make_reader(file)
            attachments = {a.name: a.data for a in reader.iter_attachments()}
            metadata = {m.name: dict(m.metadata) for m in reader.iter_metadata()}
    except (McapError, OSError, ValueError) as error:
        raise ReviewError(
            f"{path} is damaged ({error}); mend it with `linkage-vibration recover`."
        ) from None
    return attachments, metadata


def _read_model(
    attachments: Mapping[str, bytes], table_id: str
) -> tuple[Table | None, Mechanism | None, str]:
    """Return the table and the mechanism among attachments; None where they are not there."""
    table, mechanism, text = None, None, ""
    with tempfile.TemporaryDirectory() as folder:
        # All of them, as a mechanism may name files beside it.
        paths = {name: Path(folder) / Path(name).name for name in attachments}
        for name, data in attachments.items():
            paths[name].write_bytes(data)
        if f"{table_id}.npz" in paths:
            try:
                table = load_table(paths[f"{table_id}.npz"])
            except TableError:
                pass  # a table of an older format; the page does without
        for name, path in paths.items():
            if name.endswith((".yaml", ".yml")) and name not in (PARAMETERS, EXCITATIONS):
                try:
                    found = read_mechanism(path)
                except LinkageVibrationError:
                    continue  # another file, or links that come from files that are not there
                if table is None or found.model_hash == table.model_hash:
                    mechanism, text = found, attachments[name].decode()
    return table, mechanism, text


def _excitations(attachments: Mapping[str, bytes]) -> tuple[Excitation, ...]:
    if EXCITATIONS not in attachments:
        return ()
    try:
        return excitations_from_mapping(yaml.safe_load(attachments[EXCITATIONS]), EXCITATIONS)
    except (yaml.YAMLError, LinkageVibrationError):
        return ()  # of another version, that described them otherwise


def _parameters(text: str) -> dict[str, object]:
    """Return a node's parameters, whatever the node's name."""
    try:
        found = yaml.safe_load(text)
    except yaml.YAMLError:
        return {}
    while isinstance(found, dict) and len(found) == 1:
        [found] = found.values()
    return found if isinstance(found, dict) else {}
