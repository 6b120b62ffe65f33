# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Describes the page of one log: its charts, readings, tables and texts."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.recorder import FAULTS_METADATA
from linkage_vibration.drawing import palette
from linkage_vibration.mechanics.arrays import BoolArray, IntArray, runs
from linkage_vibration.mechanics.forces import GRAVITY, SOIL
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.severity import ResonanceState, ratio_words
from linkage_vibration.prediction.verdict import (
    Contribution,
    Episode,
    all_known,
    contributions,
    episodes,
    ground_and_orders,
)
from linkage_vibration.review.advice_map import advice_map
from linkage_vibration.review.findings import (
    all_speeds,
    log_limits,
    never_in_table,
    number,
    real_times,
)
from linkage_vibration.review.html import Page, thinned
from linkage_vibration.review.log import Log, gaps
from linkage_vibration.review.model_grid import linkage_grid, receptance_grid
from linkage_vibration.review.overview import drive_summary
from linkage_vibration.review.time_axis import TimeAxis, time_axis
from linkage_vibration.table.interpolation import angles_in_table

Items = list[dict[str, Any]]  # as the scripts of the page read them

DEG = 180.0 / math.pi
STATUSES = ["OK", "out of range", "invalid angle", "near a toggle"]
STATES = [state.name.lower() for state in ResonanceState]
_STYLES = {Source.ENGINE: "solid", Source.PTO: "dashed", Source.GROUND: "dotted"}
_INVALID = (Status.OUT_OF_RANGE, Status.INVALID_ANGLE)
MAX_WARNINGS = 1000  # rows of the table of warnings
_PARTS = {"ground_ratio": "ground", "orders_ratio": "orders together, at most"}  # of the load ratio
_STALE_AFTER = 1.0  # s, if the log does not hold this parameter
_LOADS = {
    "id": "contributions",
    "title": "What loaded the linkage, the worst first",
    "note": "The load ratio is the largest force in a pin or cylinder by this excitation (root "
    "mean square) over the static force there. Choose a row to go to its worst moment.",
    "head": ["excitation", "load ratio", "at", "in warning [s]", "warnings", "in note [s]"],
    "first": True,
}
_WARNINGS = {
    "id": "moments",
    "head": ["start", "load ratio", "in", "most severe", "Hz", "duration [s]"],
    "folded": True,
}


def review_page(log: Log) -> Page:
    """Return what a page shows of a log."""
    warnings, parts, severity = list[Episode](), list[Contribution](), np.empty(0)
    if log.drive is not None:
        warnings, parts = episodes(log.drive), contributions(log.drive)
        severity = log.drive.severity()
    severest = sorted(warnings, key=lambda episode: -severity[episode.worst])[:MAX_WARNINGS]
    shown = sorted(severest, key=lambda episode: episode.worst)
    marked = [episode.worst for episode in shown] + [part.worst for part in parts]
    rows = _kept(log, [] if log.drive is None else log.drive.predictions[marked].tolist())
    summary = drive_summary(log)
    missing, axis, outside = gaps(log), time_axis(log), bool(never_in_table(log))
    content: dict[str, Any] = {
        "charts": _charts(log, axis),
        "overview": {"column": "crank_angle", "factor": DEG, "label": "α3"},
        "readings": _readings(log),
        "mode_labels": [_mode_name(log, mode) for mode in range(log.n_modes)],
        "brief": ["crank_angle", *(f"f{mode + 1}" for mode in range(log.n_modes))],
        "answer": summary["sentence"],
        "calm": summary["calm"],
        "inputs": list(log.input_faults),
        "tables": _tables(log, parts, warnings, shown, rows, axis),
        "summary": _summary(log, summary, missing),
        "provenance": _provenance(log, len(rows)),
        "shades": _shades(log, missing, axis),
        **_excitations(log, axis),
        "clock": axis.knots(),
        "advice": None if outside else advice_map(log),
        "stale_after": number(log, "stale_after", _STALE_AFTER),
    }
    if outside:  # Nothing but the angle is known, and empty charts show nothing.
        content |= {"charts": content["charts"][:1], "readings": content["readings"][:2]}
        content |= {"tables": [], "mode_labels": []}
    elif log.mechanism and log.table:
        for key, grid in (("frf", receptance_grid), ("linkage", linkage_grid)):
            if terms := grid(log.mechanism, log.table):
                content[key] = terms
    name = log.table.mechanism_name.replace("_", " ") if log.table else "the linkage"
    return Page(
        title=f"Vibration review: {name}",
        subtitle=f"{log.path.name}: {len(log.stamps):,} predictions of table {log.table_id}",
        columns=_columns(log, rows, axis),
        start_ns=int(log.stamps[0]),
        breaks=np.union1d(
            np.searchsorted(log.times[rows], [end for _, end in missing]),
            np.searchsorted(rows, log.passes),
        ).tolist(),
        modes=[] if outside else palette.mode_colours(log.n_modes),
        content=content,
    )


def _mode_name(log: Log, mode: int) -> str:
    """Return the label of a mode with a capital letter."""
    label = log.mode_label(mode)
    if log.table and log.table.lateral_modes[mode]:
        label += ", of which the left side is drawn"
    return label[0].upper() + label[1:]


def provenance_rows(log: Log) -> list[list[str]]:
    """Return what made a log, as pairs of a label and a text."""
    rows = [["Log", log.path.name], ["Table", log.table_id]]
    if log.table is not None:
        table = log.table
        low, high = (DEG * angle for angle in table.alpha3_range)
        errors = f"natural frequencies and damping ratios {table.interpolation_error.max():.1e}, "
        errors += f"FRF peak {table.peak_error:.1e}, FRFs {table.frf_error:.1e}, "
        errors += f"forces {table.force_error:.1e}"
        rows += [
            ["Mechanism", f"{table.mechanism_name}, model {table.model_hash[:12]}"],
            ["Range of angles", f"{low:g} to {high:g} deg"],
            ["Relative error of the table", errors],
            ["Table built by", f"linkage_vibration {table.package_version}"],
        ]
        loads = -table.components_at_rest(np.linspace(*table.alpha3_range, 19)) / GRAVITY
        axles = [
            f"{name.removeprefix(SOIL)} {min(load):.0f} to {max(load):.0f} kg"
            for (name, _), load in zip(table.forces, loads, strict=False)
            if name.startswith(SOIL)
        ]
        rows += [["Static axle loads", ", ".join(axles)]] if axles else []
    else:
        rows.append(["Model", "the log does not hold the table that made it"])
    for name, record in log.metadata.items():
        if name not in ("rosbag2", FAULTS_METADATA) and record:
            text = ", ".join(f"{key} {value}" for key, value in record.items())
            rows.append([f"Record {name}", text])
    return rows


def clock(time: float, whole: float) -> str:
    """Return a time, s, as the axes of the page show it: in s, or with minutes and hours.

    The duration of the log decides on the form.
    """
    if whole < 120.0:
        return f"{time:.2f}"
    minutes, seconds = divmod(round(time, 1), 60.0)
    if whole < 3600.0:
        return f"{int(minutes)}:{seconds:04.1f}"
    return f"{int(minutes) // 60}:{int(minutes) % 60:02}:{seconds:04.1f}"


def _kept(log: Log, needed: list[int]) -> IntArray:
    """Return the indices of the predictions that the page holds."""
    quantities = [log.crank_angle, *log.natural_frequencies.T, log.peak_magnitude]
    changes = [np.flatnonzero(np.diff(log.status)), np.array(needed, np.int64)]
    changes += [log.passes - 1]
    changes += [np.searchsorted(log.times, [start for start, _ in gaps(log)])]
    changes += [np.flatnonzero(np.diff(np.isnan(values))) for values in log.natural_frequencies.T]
    if log.resonances is not None:
        quantities += [log.resonances.relative_margin, log.resonances.total_load_ratio]
        changes.append(np.flatnonzero(np.diff(log.resonances.state)))
    edges = np.concatenate([np.asarray(rows, dtype=np.int64) for rows in changes])
    return thinned(quantities, np.union1d(edges, np.minimum(edges + 1, len(log.stamps) - 1)))


def _columns(log: Log, rows: IntArray, axis: TimeAxis) -> dict[str, NDArray[Any]]:
    columns: dict[str, NDArray[Any]] = {
        "time": axis.place(log.times)[rows],
        "crank_angle": log.crank_angle[rows],
        "status": log.status[rows].astype(np.uint8),
        "peak_frequency": log.peak_frequency[rows].astype(np.float32),
        "peak_magnitude": log.peak_magnitude[rows].astype(np.float32),
    }
    if not np.array_equal(log.table_angle, log.crank_angle, equal_nan=True):
        columns["table_angle"] = log.table_angle[rows]
    for mode in range(log.n_modes):
        columns[f"f{mode + 1}"] = log.natural_frequencies[rows, mode].astype(np.float32)
        columns[f"s{mode + 1}"] = log.frequency_stddevs[rows, mode].astype(np.float32)
    if log.resonances is not None:
        r, names = log.resonances.rows(rows), _excitation_names(log)
        counts = {"state": r.state}
        counts["excitation"] = np.searchsorted(names, r.excitation)
        columns |= {name: values.astype(np.uint8) for name, values in counts.items()}
        part = ~_all_known(log)[rows]
        numbers = {"load_ratio": r.total_load_ratio}
        numbers["load_known"] = np.where(part, np.nan, r.total_load_ratio)
        numbers["load_part"] = np.where(part, r.total_load_ratio, np.nan)
        columns["load_of"] = part.astype(np.uint8)
        columns |= {name: values.astype(np.float32) for name, values in numbers.items()}
        if log.drive is not None and (parts := ground_and_orders(log.drive, log.excitations)):
            at = np.searchsorted(log.drive.predictions, rows, side="right") - 1
            for name, values in zip(_PARTS, parts, strict=True):
                latest = np.where(at < 0, np.nan, values[at])
                columns[name] = latest.astype(np.float32)
    return columns


def _all_known(log: Log) -> BoolArray:
    """Return at which predictions the latest total load ratio has all of its sources, (n,)."""
    assert log.drive is not None
    at = np.searchsorted(log.drive.predictions, np.arange(len(log.stamps)), side="right") - 1
    return np.asarray((at >= 0) & all_known(log.drive)[at])


def _excitation_names(log: Log) -> list[str]:
    """Return the names in the resonances, in alphabetical order; the first may be empty."""
    assert log.resonances is not None
    return [str(name) for name in np.unique(log.resonances.excitation)]


def _has_spread(log: Log) -> bool:
    """Return whether the standard deviations contain more than the error of the table."""
    by_table = log.interpolation_error[:, np.newaxis] * log.natural_frequencies
    return bool((log.frequency_stddevs > 1.001 * by_table).any())


def _charts(log: Log, axis: TimeAxis) -> Items:
    invalid, toggle = np.isin(log.status, _INVALID).any(), (log.status == Status.NEAR_TOGGLE).any()
    shades = [
        {"label": label, "colour": colour, "fill": True}
        for label, colour, shown in (
            ("no prediction", palette.GAP_SHADE, bool(gaps(log))),
            ("angle out of range or invalid", palette.INVALID_SHADE, invalid),
            ("near a toggle", palette.TOGGLE_SHADE, toggle),
        )
        if shown
    ]

    def chart(name: str, title: str, unit: str, **more: Any) -> dict[str, Any]:
        return {"id": name, "title": title, "unit": unit, **more}

    angle = {"column": "crank_angle", "factor": DEG, "colour": palette.INK}
    charts = [chart("angle", "Crank angle α3", "deg", series=[angle], key=shades)]
    for mode, colour in enumerate(palette.mode_colours(log.n_modes)):
        name, title = f"f{mode + 1}", f"Natural frequency of m{_mode_name(log, mode)[1:]}"
        line: dict[str, Any] = {"column": name, "colour": colour, "width": 2}
        key: Items = []
        if _has_spread(log):
            line["spread"] = f"s{mode + 1}"
            key.append({"label": "± 2 standard deviations", "colour": f"{colour}40", "fill": True})
        key.append({"label": "excitations", "colour": "#555555"})
        charts.append(chart(name, title, "Hz", mode=mode, series=[line], key=key))
    peak = {"column": "peak_magnitude", "colour": palette.PEAK, "width": 1.8}
    charts.append(chart("peak", "FRF peak", "m/N", log=True, series=[peak]))
    if log.resonances is not None and np.isfinite(log.resonances.total_load_ratio).any():
        limits = log_limits(log)
        title = "Load ratio: largest force over the static force there"
        total: dict[str, Any] = {"colour": palette.COLOURS[0], "width": 1.8}
        part = {"colour": palette.COLOURS[0], "width": 1.2, "style": "dotted"}
        series: Items = []
        key = [{"label": "limits of a warning and a note", "colour": "#5f5f5f", "style": "dashed"}]
        key.append({"label": "all", **total})
        spans = _spans(log, ~_all_known(log), axis)
        if spans:
            key.append({"label": "a part of all, as a source is not known", **part})
            hatched = {"label": "not known in all", "colour": "#f3f3f3", "hatched": True}
            key.append(hatched | {"fill": True})
        if log.drive is not None and ground_and_orders(log.drive, log.excitations):
            for (name, label), colour in zip(_PARTS.items(), palette.COLOURS[1:3], strict=True):
                series.append({"column": name, "colour": colour, "width": 1.2})
                key.append({"label": label, "colour": colour})
        series += [{"column": "load_known", **total}, {"column": "load_part", **part}]
        guides = [limits.warning, limits.note]
        hatches = [[*span, "unknown"] for span in spans]
        charts.append(
            chart("load", title, "1", series=series, guides=guides, key=key, shades=hatches)
        )
    return charts


def _readings(log: Log) -> Items:
    def reading(name: str, label: str, **more: Any) -> dict[str, Any]:
        return {"id": name, "label": label, **more}

    angle = {"column": "crank_angle", "factor": DEG, "unit": "deg", "digits": 8}
    readings = [
        reading("crank_angle", "Crank angle α3", **angle),
        reading("status", "Status", column="status", words=STATUSES),
    ]
    for mode, colour in enumerate(palette.mode_colours(log.n_modes)):
        name, spread = f"f{mode + 1}", {"spread": f"s{mode + 1}"} if _has_spread(log) else {}
        line = {"colour": colour, "column": name, "unit": "Hz", "digits": 7, **spread}
        line["predicted"] = "peak_magnitude"
        readings.append(reading(name, _mode_name(log, mode), **line))
    readings += [
        reading("peak", "FRF peak", column="peak_magnitude", unit="m/N"),
        reading("peak_f", "FRF peak frequency", column="peak_frequency", unit="Hz"),
    ]
    if log.resonances is None:
        return readings
    names = [name or "none" for name in _excitation_names(log)]
    return [
        *readings,
        reading("state", "State", column="state", words=STATES),
        reading("load", "Load ratio", column="load_ratio", digits=3),
        reading("load_of", "Load ratio of", column="load_of", words=["all sources", "a part"]),
        reading("excitation", "Most severe excitation", column="excitation", words=names),
    ]


def _tables(
    log: Log,
    parts: Sequence[Contribution],
    every: Sequence[Episode],
    shown: Sequence[Episode],
    rows: IntArray,
    axis: TimeAxis,
) -> Items:
    """Return the tables of excitations, none without excitations, and of warnings."""
    if (drive := log.drive) is None:
        note = "The log holds no resonances, as no speed of engine, PTO or ground was known."
        return [_WARNINGS | {"title": "Warnings (0)", "note": note, "rows": Items()}]
    whole, times, severity = float(real_times(log).max()), axis.place(log.times), drive.severity()

    def place(message: int) -> dict[str, Any]:
        """Return where the page shows a resonance; the ground has no frequency and no mode."""
        at, prediction = drive.resonances.message(message), int(drive.predictions[message])
        index = int(np.searchsorted(rows, prediction))
        where: dict[str, Any] = {"time": float(times[prediction]), "index": index}
        if not math.isnan(at.natural_frequency):
            where |= {"mode": int(at.mode), "y": float(at.excitation_frequency)}
        return where

    loads, warnings = Items(), Items()
    for part in parts:
        cells, where = ["not known", ""], dict[str, Any]()
        if not math.isnan(part.load_ratio):
            time = clock(float(drive.times[part.worst]), whole)
            cells, where = [f"{part.load_ratio:.3f}", time], place(part.worst)
        held = [f"{part.warning_time:.2f}", str(part.warnings), f"{part.note_time:.2f}"]
        held = held if part.known else [""] * len(held)
        loads.append({"cells": [part.name, *cells, *held], "length": 0.0, **where})
    for episode in shown:
        at = drive.resonances.message(episode.worst)
        hertz = at.excitation_frequency
        ratio = "doubted" if drive.doubted[episode.worst] else f"{at.total_load_ratio:.3f}"
        cells = [clock(episode.start, whole), ratio, at.total_load_place]
        cells += [at.excitation, "" if math.isnan(hertz) else f"{hertz:.1f}"]
        row = {"cells": [*cells, f"{episode.duration:.2f}"], "length": episode.duration}
        row["severity"] = float(severity[episode.worst])
        warnings.append(place(episode.worst) | row)
    note = "Each row is a warning at its worst moment. Choose a row to go there."
    if len(every) > len(shown):
        note += f" Of {len(every)} warnings, the {MAX_WARNINGS} with the largest load ratios."
    table = _WARNINGS | {"title": f"Warnings ({len(every)})", "rows": warnings}
    table["note"] = note if every else "There was no warning."
    return [*([_LOADS | {"rows": loads}] if loads else []), table]


def _summary(log: Log, of: dict[str, Any], missing: list[tuple[float, float]]) -> Items:
    """Return what a page says at a glance, of values of `drive_summary`."""
    items: Items = []

    def add(label: str, value: str, alert: bool = False) -> None:
        items.append({"label": label, "value": value, "alert": alert})

    add("Drive", f"{_span(log.times[-1])}, {of['predictions']:,} predictions")
    valid = np.isfinite(log.peak_magnitude)
    if valid.any():
        angles = log.crank_angle[valid] * DEG
        add("Crank angle", f"{angles.min():.1f} to {angles.max():.1f} deg")
        for mode, values in enumerate(log.natural_frequencies[valid].T):
            known = values[np.isfinite(values)]
            parts = [f"{known.min():.2f} to {known.max():.2f} Hz"] if len(known) else []
            if overdamped := len(values) - len(known):
                parts.append(f"overdamped in {overdamped:,} predictions")
            add(_mode_name(log, mode), ", ".join(parts))
    warnings, worst, share = of["warnings"], of["worst"], of["known_share"]
    text = "none"
    if warnings:
        text = (
            f"{warnings}, {100.0 * of['in_warning_s'] / (log.times[-1] or 1.0):.1f} % of the time"
        )
    elif not share:
        text = "not known"
    add("Warnings", text, alert=not of["calm"])
    add("Loads not known", f"{100.0 * (1.0 - share):.1f} % of the time" if share < 1.0 else "never")
    if worst is not None:
        load = f"{ratio_words(worst['load_ratio'])} in {worst['place'] or 'the pins'}"
        angle = math.radians(worst["crank_angle_deg"] or math.nan)
        add("Largest load", f"{load}{_static_force(log, worst['place'], angle)}")
    if reason := of["model"]["unknown_deviations"]:
        add("Standard deviations", reason)
    add("Predictions not OK", f"{of['not_ok']:,}" if of["not_ok"] else "none", bool(of["not_ok"]))
    length = f"{len(missing)}, {_span(sum(end - start for start, end in missing))} in total"
    add("Gaps", length if missing else "none", alert=bool(missing))
    if len(log.passes):
        back = real_times(log)[log.passes - 1] - real_times(log)[log.passes]
        text = f"{len(back)} times, by up to {_span(float(back.max()))}"
        add("The clock jumped back", text, alert=True)
    return items


def _static_force(log: Log, place: str, alpha3: float) -> str:
    """Return the force that a load ratio refers to, in words; empty if the log has no table."""
    if log.table is None or place not in log.table.force_places:
        return ""
    angle = angles_in_table(np.array([alpha3]), log.table.alpha3_range)
    force = log.table.reference_forces(angle)[log.table.force_places.index(place), 0]
    return f"; the static force there is {1e-3 * force:.3g} kN"


def _span(seconds: float) -> str:
    """Return a duration in s, min or h."""
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    return f"{seconds / 60.0:.1f} min" if seconds < 3600.0 else f"{seconds / 3600.0:.2f} h"


def _provenance(log: Log, n_kept: int) -> dict[str, Any]:
    n = len(log.stamps)
    text = f"all {n:,} predictions"
    if n_kept < n:
        text = f"{n_kept:,} of {n:,} predictions, with the extremes of every stretch"
    exact = "times and angles are exact, other numbers have 7 digits"
    rows = [*provenance_rows(log), ["This page holds", f"{text}; {exact}"]]
    texts = {"Parameters": log.parameters_text, "Mechanism": log.mechanism_text}
    files = [{"name": name, "text": text} for name, text in texts.items() if text]
    return {"title": "What made this log", "rows": rows, "files": files}


def _shades(log: Log, missing: list[tuple[float, float]], axis: TimeAxis) -> list[list[Any]]:
    times, real = axis.place(log.times), real_times(log)
    shades: list[list[Any]] = []
    for start, end in missing:
        text = [_span(end - start)] if (start, end) in axis.shortened else []
        shades.append([*axis.place(np.array([start, end])).tolist(), "gap", *text])
    for k in log.passes.tolist():
        text = [f"clock back {_span(float(real[k - 1] - real[k]))}"]
        shades.append([*times[[k - 1, k]].tolist(), "jump", *text])
    for kind, statuses in (("range", _INVALID), ("toggle", (Status.NEAR_TOGGLE,))):
        shades += [[*span, kind] for span in _spans(log, np.isin(log.status, statuses), axis)]
    return shades


def _spans(log: Log, flags: BoolArray, axis: TimeAxis) -> list[list[float]]:
    """Return from where to where on the axis flags of predictions, (n,), are true."""
    times = axis.place(log.times)
    return [times[[start, min(end, len(times) - 1)]].tolist() for start, end in runs(flags)]


def _excitations(log: Log, axis: TimeAxis) -> dict[str, Any]:
    """Return the speeds, and for each excitation the ratio of its frequency, Hz, to its speed.

    There are none if the log lacks their file.
    """
    speeds = all_speeds(log)
    shown = [each for each in log.excitations if each.source in speeds and not each.terrain]
    return {
        "speeds": {
            source.value: {"times": axis.place(times), "values": values.astype(np.float32)}
            for source, (times, values) in speeds.items()
            if any(each.source is source for each in shown)
        },
        "excitations": [
            {
                "name": each.name,
                "style": _STYLES[each.source],
                "source": each.source.value,
                "ratio": each.ratio,
            }
            for each in shown
        ],
    }
