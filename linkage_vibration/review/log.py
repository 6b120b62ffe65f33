# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads a log: its predictions, its resonances and speeds, and what made them."""

import functools
import itertools
import json
import math
import re
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.exceptions import McapError
from mcap.reader import make_reader
from numpy.typing import NDArray

from linkage_vibration.bags.message_columns import (
    LOG_TIME,
    PLACE,
    Columns,
    first_topic,
    header_stamps,
    read_columns,
    topic_types,
)
from linkage_vibration.bags.message_types import FLOAT64
from linkage_vibration.bags.reading import mcap_files
from linkage_vibration.bags.recorder import FAULTS_METADATA, RECORDING_METADATA
from linkage_vibration.drawing.intervals import gap_starts, in_passes, one_after_the_other
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray, IntArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.csv_tables import prediction_table, table_text, unit_suffix
from linkage_vibration.messages.fields import Field, message_fields
from linkage_vibration.messages.topics import ASSESSED, PREDICTION
from linkage_vibration.playback.readings import recorded_faults
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.judge import InputFault, InputJudge
from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.provenance import EXCITATIONS, PARAMETERS
from linkage_vibration.prediction.resonance import described
from linkage_vibration.prediction.settings import Parameters, with_values
from linkage_vibration.prediction.verdict import Drive, drive_of
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.loaded_model import fitting
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.missing_library import needed
from linkage_vibration.support.resources import command
from linkage_vibration.table.interpolation import angles_in_table, covers_a_turn
from linkage_vibration.table.table import Table, TableError, load_table

_EACH = "states", "load_ratios", "load_ratio_factors", "velocities"  # what of each excitation
_DERIVED = (
    Field("margin", "float64", False, comment="Hz"),
    Field("relative_margin", "float64", False, comment="1"),
    Field("approach", "int8", False),
    Field("time_to_crossing", "float64", False, comment="s"),
    Field("load_ratio", "float32", False, comment="1"),
    Field("load_ratio_factor", "float32", False, comment="1"),
)
"""What `described` adds to the fields of messages."""
_FILE_NAME = re.compile(r"(?!\.\.?$)[^\0]{1,80}")
_MISSING: dict[str, Any] = {"f": np.nan, "O": "", "i": 0, "u": 0, "b": False}
_INDICES = "excitation_index", "mode"


class ReviewError(LinkageVibrationError):
    """A log cannot be reviewed, or two logs cannot be compared."""


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """A log of predictions, in the order of their stamps, and what made them.

    Attributes
    ----------
    path : Path
        The file.
    stamps, received, status : ndarray of int, (n,)
        ns, also those of the receipt, and the message's constants.
    crank_angle : ndarray, (n,)
        rad.
    natural_frequencies, damping_ratios : ndarray, (n, n_modes)
        Hz and 1; NaN for an overdamped mode.
    frequency_stddevs, damping_ratio_stddevs : ndarray, (n, n_modes)
        Hz and 1; NaN where they are not known.
    faults : tuple of InputFault
        The faults of the inputs that the diagnostics of the node have, and when they were there.
    passes : ndarray of int, (n_jumps,)
        The first prediction after each jump of the clock to an earlier time. Stamps ascend only
        between jumps.
    peak_frequency, peak_magnitude : ndarray, (n,)
        The peak of the FRF, Hz and m/N.
    interpolation_error : ndarray, (n,)
        Bound of the relative errors of natural frequencies and damping ratios, 1.
    drive : Drive or None
        All assessments, with states, load ratios and velocities of each excitation; None if the log
        holds none.
    resonances : MessageColumns or None
        The latest ``LoadState`` at each prediction with its ``Resonance`` and ``Levels``, without
        headers, ``table_id`` and sequences, and beside them margin, relative margin, direction of
        approach, time to crossing, and load ratio of the most severe excitation. Before the first
        one, the state is unknown, and other fields are NaN, 0, -1 or "". None if there is none.
    speeds : dict of Source to (times, values)
        Speeds on topics: s since the first stamp, and rpm or m/s. Speeds have no stamps; their
        times are those of their receipt, less the median delay of the predictions.
    excitations : tuple of Excitation
        All excitations that were monitored; empty if the log does not describe them.
    table, table_id : Table or None, str
        The table that made the predictions, if the log holds it, and its name.
    mechanism : Mechanism or None
        The mechanism that the table was built from, if the log holds it.
    parameters : dict of str
        The parameters of the node or the replay that made the log.
    mechanism_text, parameters_text, excitations_text : str
        The same, and the excitations, as YAML; empty if the log does not hold them.
    metadata : dict of str to dict of str to str
        The log's metadata records by their names.
    """

    path: Path
    stamps: IntArray
    received: IntArray
    status: IntArray
    crank_angle: FloatArray
    natural_frequencies: FloatArray
    frequency_stddevs: FloatArray
    damping_ratios: FloatArray
    damping_ratio_stddevs: FloatArray
    peak_frequency: FloatArray
    peak_magnitude: FloatArray
    interpolation_error: FloatArray
    drive: Drive | None
    resonances: MessageColumns | None
    speeds: dict[Source, tuple[FloatArray, FloatArray]]
    excitations: tuple[Excitation, ...]
    table: Table | None
    table_id: str
    mechanism: Mechanism | None
    mechanism_text: str
    parameters: dict[str, object]
    parameters_text: str
    excitations_text: str
    metadata: dict[str, dict[str, str]]
    passes: IntArray
    faults: tuple[InputFault, ...]

    def __repr__(self) -> str:
        """Return the file and its size, in a line."""
        return f"Log({self.path}: {len(self.stamps)} predictions of {self.n_modes} modes)"

    @property
    def input_faults(self) -> tuple[str, ...]:
        """A sentence for each fault of the inputs."""
        return tuple(fault.sentence for fault in self.faults)

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return int(self.natural_frequencies.shape[1])

    def to_xarray(self) -> Any:
        """Return the predictions over ``time``, their stamps, as an `xarray.Dataset`.

        Its attribute ``unknown_deviations`` says why standard deviations are NaN, if any are.
        """
        why = {} if self.table is None else {"unknown_deviations": self.table.unknown_deviations}
        data = MessageColumns(**_predictions(self), **why).to_xarray().rename(row="time")
        return data.assign_coords(time=self.stamps.astype("datetime64[ns]"))

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame` with the columns of `review --csv` over the stamps, UTC.

        It needs the extra `xarray`, which brings pandas.

        Raises
        ------
        LinkageVibrationError
            If pandas is not installed.
        """
        with needed("xarray", "A data frame needs pandas", LinkageVibrationError):
            import pandas
        table = log_table(self)
        index = pandas.to_datetime(table.pop("stamp_ns"), utc=True).rename("time")
        return pandas.DataFrame(table, index=index)

    def mode_label(self, mode: int) -> str:
        """Return the label of a mode, counted from 0, such as "mode 4 (implement heave)"."""
        return f"mode {mode + 1}" if self.table is None else self.table.mode_label(mode)

    def mode_name(self, mode: int) -> str:
        """Return the name of a mode, counted from 0; empty if the log has no table."""
        names = () if self.table is None else self.table.mode_names
        return names[mode] if mode < len(names) else ""

    @property
    def times(self) -> FloatArray:
        """Seconds since the first stamp, (n,); after a jump of the clock back, they continue."""
        return one_after_the_other(self.stamps, self.passes)

    @property
    def table_angle(self) -> FloatArray:
        """The crank angle without the whole turns of a crank that turns around, rad, (n,)."""
        if self.table is None or not covers_a_turn(self.table.alpha3_range):
            return self.crank_angle
        with np.errstate(invalid="ignore"):  # an infinite angle
            return angles_in_table(self.crank_angle, self.table.alpha3_range)


def read_log(path: str | Path) -> Log:
    """Read a log.

    Parameters
    ----------
    path : str or Path
        An MCAP file, as the node or a replay writes it.

    Raises
    ------
    BagError
        If the file cannot be read.
    ReviewError
        If it holds no prediction, or if it is damaged.
    """
    path = Path(path)
    predictions, resonances, speeds = _read_messages(path)
    order, passes = in_passes(header_stamps(predictions))
    if (np.diff(order) != 1).any():  # a copy takes time and memory
        predictions = {name: column[order] for name, column in predictions.items()}
    stamps, status = header_stamps(predictions), predictions.pop("status").astype(np.int64)
    table_id = str(predictions.pop("table_id")[-1])
    attachments, metadata = _read_provenance(path)
    table, mechanism, mechanism_text, excitations = _read_model(attachments, table_id)
    parameters_text = attachments.get(PARAMETERS, b"").decode(errors="replace")
    names = [excitation.name for excitation in excitations]
    why = table.unknown_factors if table else "the log does not hold the table that made it"
    drive, at_predictions = _resonances(resonances, predictions, passes, names, why)
    log = Log(
        path=path,
        stamps=stamps,
        received=predictions[LOG_TIME],
        status=status,
        drive=drive,
        resonances=at_predictions,
        speeds={
            source: (_speed_times(columns, predictions, passes), columns["data"])
            for source, columns in speeds.items()
            if len(columns["data"])
        },
        excitations=excitations,
        table=table,
        table_id=table_id,
        mechanism=mechanism,
        mechanism_text=mechanism_text,
        parameters=_parameters(parameters_text),
        parameters_text=parameters_text,
        excitations_text=attachments.get(EXCITATIONS, b"").decode(errors="replace"),
        metadata=metadata,
        passes=passes,
        faults=(),
        **{name.removeprefix("frf_"): predictions[name] for name in _numbers() if name != "status"},
    )
    log = replace(log, faults=_input_faults(log))
    if drive is not None:
        log = replace(log, drive=replace(drive, doubted=_doubted(log, drive)))
    return log


def _read_messages(path: Path) -> tuple[Columns, Columns, dict[Source, Columns]]:
    """Return the columns of predictions, resonances and speeds, in the order of the file."""
    types = topic_types(path)
    kinds = PREDICTION, *ASSESSED
    topics = [first_topic(types, kind) for kind in kinds]
    speeds = {
        source: topic
        for source in Source
        for topic, kind in types.items()
        if topic.endswith(f"/{source.value}_speed") and kind == FLOAT64
    }
    wanted = {topic: types[topic] for topic in [*topics, *speeds.values()] if topic}
    fields = [field for kind in ASSESSED for field in message_fields(kind)]
    sequences = {field.name for field in fields if field.is_sequence}
    unused = ["header.frame_id", *(sequences - {*_EACH})]
    columns = read_columns(path, wanted, as_written=True, unused=unused)
    predictions, *assessed = (columns.get(topic, {}) for topic in topics)
    if not len(predictions.get("status", ())):
        raise ReviewError(
            f"{path} holds no prediction; predict for a bag with `{command('replay')}` first, and "
            "look in a log of the node for the joint, which may never have been published."
        )
    for kind, read in zip(kinds, (predictions, *assessed), strict=True):
        lacking = {f.name for f in message_fields(kind)} - {*unused, *read}
        if read and lacking:
            raise ReviewError(
                f"{path} was written by another version, whose {kind.split('/')[-1]} has no "
                f"{', '.join(sorted(lacking))}; replay the log with this one."
            )
    of_speeds = {source: columns[topic] for source, topic in speeds.items()}
    return predictions, _together(assessed), of_speeds


def _together(assessed: list[Columns]) -> Columns:
    """Return the columns of messages about assessed readings, at the stamps that all have."""
    if not all(len(columns.get(PLACE, ())) for columns in assessed):
        return {}
    stamps = [header_stamps(columns) for columns in assessed]
    if len({each.tobytes() for each in stamps}) > 1:
        shared = functools.reduce(np.intersect1d, stamps)
        for i, each in enumerate(stamps):
            first = np.sort(np.unique(each, return_index=True)[1])
            rows = first[np.isin(each[first], shared)]
            assessed[i] = {name: column[rows] for name, column in assessed[i].items()}
    return {name: column for columns in reversed(assessed) for name, column in columns.items()}


def gaps(log: Log) -> list[tuple[float, float]]:
    """Return the start and the end of each gap between predictions, s since the first stamp."""
    times = log.times.tolist()
    return [(times[i], times[i + 1]) for i in gap_starts(log.times).tolist()]


def _input_faults(log: Log) -> tuple[InputFault, ...]:
    """Return the faults of the inputs: those that a replay wrote, or by what the log holds."""
    if FAULTS_METADATA in log.metadata:
        texts = log.metadata[FAULTS_METADATA].values()
        return tuple(InputFault(**json.loads(text)) for text in texts)
    stroke = log.table.alpha3_range if log.table else (-math.inf, math.inf)
    with suppress(LinkageVibrationError):  # also of parameters of another version
        settings = with_values(Parameters(), log.parameters)
        return tuple(recorded_faults(log.path, settings, stroke))
    judge = InputJudge("the crank angle", stroke)
    unknown = np.full(len(log.stamps), np.nan)
    known = (log.status != Status.OUT_OF_RANGE) | (log.table is None)
    columns = log.received, log.stamps, log.crank_angle, unknown, known
    judge.readings(*(column.tolist() for column in columns))
    for source, (times, values) in log.speeds.items():
        stamps = (1e9 * times).astype(np.int64) + log.received[0]
        for time, value in zip(stamps.tolist(), values.tolist(), strict=True):
            judge.speed(source, time, value, f"{source.value}_speed")
    return tuple(judge.faults())


def _doubted(log: Log, drive: Drive) -> BoolArray:
    """Return which assessments, (n,), have a doubted reading since the assessment before."""
    times = getattr(drive.resonances, LOG_TIME)
    before = np.append(min(times[0], log.received[0]) - 1, np.minimum(times[:-1], times[1:] - 1))
    return doubted_between(log, before, times)


def doubted_between(log: Log, before: NDArray[np.int64], times: NDArray[np.int64]) -> BoolArray:
    """Return whether values were doubted after times of receipt until others, ns, (n,)."""
    doubted = np.zeros(len(times), np.bool_)
    for begin, end in (each for fault in log.faults if fault.doubts for each in fault.times):
        doubted |= (times >= begin) & (before < end)
    return doubted


def problems(log: Log) -> list[str]:
    """Return a sentence for each fault of the inputs, and kind of missing or invalid prediction."""
    sentences = list(log.input_faults)
    if faulty := int((log.status != Status.OK).sum()):
        sentences.append(f"{faulty} of {len(log.stamps)} predictions are not OK.")
    if len(log.passes):
        often = "once" if len(log.passes) == 1 else f"{len(log.passes)} times"
        sentences.append(f"The clock jumped back {often}.")
    if missing := gaps(log):
        longest = max(end - start for start, end in missing)
        where = "one gap of" if len(missing) == 1 else f"{len(missing)} gaps of up to"
        sentences.append(f"Predictions are missing in {where} {longest:.3g} s.")
    records = [r for name, r in log.metadata.items() if name.startswith(RECORDING_METADATA)]
    if dropped := max((int(record.get("dropped", 0)) for record in records), default=0):
        sentences.append(f"The log lacks {dropped} messages that the disk was too slow to record.")
    return sentences


def csv_text(log: Log) -> str:
    """Return a log as CSV, a line for each prediction; numbers that are not known are "nan"."""
    return table_text(log_table(log))


def log_table(log: Log) -> dict[str, NDArray[Any]]:
    """Return the columns of a log, (n,), by the names of their fields, as its CSV file has them."""
    why = "" if log.table is None else log.table.unknown_deviations
    table = {"stamp_ns": log.stamps} | prediction_table(_predictions(log), why)
    if (of := log.resonances) is not None and log.drive is not None:
        for field in resonance_fields():
            name = "resonance_state" if field.name == "state" else field.name
            table[name + unit_suffix(field)] = getattr(of, field.name)
        lost = np.isnan(of.load_ratio_factor) & np.isfinite(of.load_ratio)
        lost |= np.isnan(of.total_load_ratio_factor) & np.isfinite(of.total_load_ratio)
        table["unknown_factors"] = np.where(lost, log.drive.resonances.unknown_factors, "")
        modes = np.where(np.isfinite(of.natural_frequency), of.mode + 1, 0)
        names = np.array(["", *(log.mode_name(mode) for mode in range(log.n_modes))])
        table |= {"mode": modes, "mode_name": names[np.minimum(modes, log.n_modes)]}
    return table


def _predictions(log: Log) -> dict[str, NDArray[Any]]:
    """Return the columns of the predictions by the names of their fields."""
    return {name: getattr(log, name.removeprefix("frf_")) for name in _numbers()}


def _numbers() -> list[str]:
    """Return the names of the fields of a prediction that a log has as arrays of numbers."""
    return [f.name for f in message_fields(PREDICTION) if f.type in ("float64", "uint8")]


def _speed_times(speeds: Columns, predictions: Columns, passes: IntArray) -> FloatArray:
    """Return the times of speeds, s, as those of the predictions; speeds have no stamps."""
    stamps = header_stamps(predictions)
    if len(passes):  # The clock of the log may have jumped, too, so only places are certain.
        places = np.maximum.accumulate(predictions[PLACE])
        return np.interp(speeds[PLACE], places, one_after_the_other(stamps, passes))
    start = stamps[0] + int(np.median(predictions[LOG_TIME] - stamps))
    return np.asarray((speeds[LOG_TIME] - start) / 1e9)


def _resonances(
    columns: Columns, predictions: Columns, passes: IntArray, names: Sequence[str], why: str
) -> tuple[Drive | None, MessageColumns | None]:
    """Return all assessments, and the latest at each prediction; `why` says why factors are NaN."""
    if not len(columns.get("state", ())):
        return None, None
    stamps, places = header_stamps(predictions), predictions[PLACE]
    taken = header_stamps(columns)
    begins = np.minimum.reduceat(places, passes)  # The earliest stamp may be written later.
    later = np.searchsorted(begins, columns[PLACE], side="right")
    order = np.lexsort((taken, later))
    rows, there = np.zeros(len(stamps), np.int64), np.zeros(len(stamps), np.bool_)
    predicted = np.zeros(len(taken), np.int64)  # the prediction that each resonance belongs to
    for k, (low, high) in enumerate(itertools.pairwise([0, *passes.tolist(), len(stamps)])):
        mine = order[later[order] == k]
        if len(mine):
            at = np.searchsorted(taken[mine], stamps[low:high])
            exact = taken[mine[np.minimum(at, len(mine) - 1)]] == stamps[low:high]
            at -= ~exact  # none at this stamp: the last one before
            rows[low:high] = mine[np.maximum(at, 0)]
            there[low:high] = at >= 0
            first = low + np.searchsorted(stamps[low:high], taken[mine])
            predicted[mine] = np.minimum(first, high - 1)
    numbers = {
        name: column.astype(np.int64) if column.dtype.kind in "iu" else column  # may be negative
        for name, column in columns.items()
    }
    every = vars(described(MessageColumns(**numbers)))
    shown = resonance_fields()
    kept = {*_EACH, LOG_TIME, *(field.name for field in shown)}
    # As they were written: a stamp that is earlier than the one before ended the warnings.
    messages = MessageColumns(**{n: c for n, c in every.items() if n in kept}, unknown_factors=why)
    angles, start, end = predictions["crank_angle"][predicted], int(stamps[0]), int(stamps[-1])
    drive = drive_of(taken, start, messages, angles, names, predicted, end)
    values: dict[str, Any] = {}
    for field in shown:
        column = every[field.name][rows]
        other: Any = -1 if field.name in _INDICES else _MISSING[column.dtype.kind]
        values[field.name] = np.where(there, column, other)
    return drive, MessageColumns(**values)


def resonance_fields() -> list[Field]:
    """Return the fields that a log shows of an assessment: numbers, texts, and what follows."""
    fields = {f.name: f for kind in reversed(ASSESSED) for f in message_fields(kind)}
    hidden = {name for name, field in fields.items() if field.is_sequence} | {"table_id"}
    shown = [f for f in fields.values() if f.name not in hidden and "header." not in f.name]
    return [*shown, *_DERIVED]


def _read_provenance(path: Path) -> tuple[dict[str, bytes], dict[str, dict[str, str]]]:
    """Return the attachments and the metadata records of a log by their names."""
    attachments: dict[str, bytes] = {}
    metadata: dict[str, dict[str, str]] = {}
    for file_path in mcap_files(path):  # a folder may have several, and another bag has none
        try:
            with file_path.open("rb") as file:
                reader = make_reader(file)
                attachments |= {a.name: a.data for a in reader.iter_attachments()}
                metadata |= {m.name: dict(m.metadata) for m in reader.iter_metadata()}
        except (McapError, OSError, ValueError) as error:
            raise ReviewError(
                f"{file_path} is damaged ({error}); repair it with `{command('recover')}`."
            ) from None
    return attachments, metadata


def _read_model(
    attachments: Mapping[str, bytes], table_id: str
) -> tuple[Table | None, Mechanism | None, str, tuple[Excitation, ...]]:
    """Return the table, the mechanism, its text and excitations; None or empty if absent."""
    table, mechanism, text, excitations = None, None, "", tuple[Excitation, ...]()
    with tempfile.TemporaryDirectory() as folder:
        # All attachments are written, as a mechanism may refer to files beside it.
        # A foreign program may have given them names that no file can have.
        names = {name: Path(name).name for name in attachments}
        paths = {n: Path(folder, file) for n, file in names.items() if _FILE_NAME.fullmatch(file)}
        try:
            for name, path in paths.items():
                path.write_bytes(attachments[name])
        except OSError as error:
            raise ReviewError(
                f"The model of the log cannot be unpacked into {folder} ({error.strerror}); make "
                "room there, or name another folder in TMPDIR."
            ) from None
        if f"{table_id}.npz" in paths:
            with suppress(TableError):  # of an older format; the page does without it
                table = load_table(paths[f"{table_id}.npz"])
        for name, path in paths.items():
            if name.endswith((".yaml", ".yml")) and name not in (PARAMETERS, EXCITATIONS):
                try:
                    candidate = read_mechanism(path)
                except LinkageVibrationError:
                    continue  # This is another file, or its links refer to missing files.
                if table is None or candidate.model_hash == table.model_hash:
                    mechanism, text = candidate, attachments[name].decode()
        if EXCITATIONS in paths:
            # Another version of the package may have described them differently.
            with suppress(LinkageVibrationError):
                excitations = read_excitations(paths[EXCITATIONS])
                if table and mechanism:
                    excitations = fitting(excitations, table, mechanism)
    return table, mechanism, text, excitations


def _parameters(text: str) -> dict[str, object]:
    """Return the parameters in a ROS parameter file, whatever the name of the node is."""
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError:
        return {}
    while isinstance(content, dict) and len(content) == 1:
        [content] = content.values()
    return content if isinstance(content, dict) else {}
