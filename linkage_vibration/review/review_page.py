# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Describes the page of one log: its charts, readings, tables and texts."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.recorder import FAULTS_METADATA
from linkage_vibration.drawing import palette
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray, IntArray, runs
from linkage_vibration.mechanics.forces import GRAVITY, SOIL
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.severity import GAP, ResonanceState, ratio_words
from linkage_vibration.prediction.verdict import (
    Contribution,
    Drive,
    Episode,
    above_and_below,
    contributions,
    episodes,
    ground_and_orders,
)
from linkage_vibration.review.advice_map import advice_map
from linkage_vibration.review.findings import (
    all_counted,
    all_speeds,
    first_sentence,
    log_limits,
    number,
    real_times,
    remedy,
    verdict,
)
from linkage_vibration.review.html import COVERAGE, Page, page_parts, plain_html, thinned
from linkage_vibration.review.log import Log, gaps
from linkage_vibration.review.model_grid import linkage_grid
from linkage_vibration.review.overview import drive_summary
from linkage_vibration.review.time_axis import TimeAxis, time_axis
from linkage_vibration.table.interpolation import angles_in_table

Items = list[dict[str, Any]]  # as the scripts of the page read them

DEG = 180.0 / math.pi
STATUSES = ["OK", "out of range", "invalid angle", "near a toggle"]
STATES = [state.name.lower() for state in ResonanceState]
_INVALID = (Status.OUT_OF_RANGE, Status.INVALID_ANGLE)
MAX_WARNINGS = 1000  # rows of the table of warnings
_SOURCES = 3  # the largest, which the first screen names
_SHADES = {"unknown": "#f3f3f3", "above": palette.ABOVE_SHADE}
_PARTS = {"ground_ratio": "ground", "orders_ratio": "orders together, at most"}  # of the load ratio
_STALE_AFTER = 1.0  # s, if the log does not hold this parameter


def page_of(log: Log) -> Iterator[bytes]:
    """Yield the page of a log, which has sentences alone if no crank angle is valid."""
    if not np.isin(log.status, _INVALID).all():
        return page_parts(review_page(log))
    sentences = [first_sentence(log), *log.input_faults, f"{_subtitle(log)}."]
    text = plain_html(_title(log), sentences, "", calm=False)
    return iter([text.encode(errors="backslashreplace")])


def _title(log: Log) -> str:
    """Return the title of a page."""
    name = log.table.mechanism_name.replace("_", " ") if log.table else "the linkage"
    return f"Vibration review: {name}"


def _subtitle(log: Log) -> str:
    """Return which predictions a page is about."""
    predictions = "1 prediction" if len(log.stamps) == 1 else f"{len(log.stamps):,} predictions"
    return f"{log.path.name}: {predictions} of table {log.table_id}"


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
    summary, missing, axis = drive_summary(log), gaps(log), time_axis(log)
    answer, rest = verdict(log, summary["sentence"])
    breaks = [np.searchsorted(log.times[rows], [end for _, end in missing])]
    breaks += [np.searchsorted(rows, log.passes)]
    content: dict[str, Any] = {
        "n": len(rows),
        "start_ms": int(log.stamps[0]) / 1e6,
        "breaks": np.union1d(*breaks).tolist(),
        "modes": palette.mode_colours(log.n_modes),
        "coverage": COVERAGE,
        "subtitle": _subtitle(log),
        "charts": _charts(log, axis),
        "overview": {"column": "crank_angle", "factor": DEG, "label": "α3"},
        "readings": _readings(log),
        "mode_labels": [_mode_name(log, mode) for mode in range(log.n_modes)],
        "brief": ["crank_angle", *(f"f{mode + 1}" for mode in range(log.n_modes))],
        "answer": answer,
        "rest": rest,
        "calm": summary["calm"],
        "inputs": list(log.input_faults),
        "tables": _tables(log, parts, warnings, shown, rows, axis),
        "provenance": _provenance(log, summary, missing, len(rows)),
        "shades": _shades(log, missing, axis),
        **_excitations(log, axis),
        "clock": axis.knots(),
        "advice": advice_map(log),
        "stale_after": number(log, "stale_after", _STALE_AFTER),
    }
    if log.mechanism and log.table and (grid := linkage_grid(log.mechanism, log.table)):
        content["linkage"] = grid
    return Page(_title(log), _columns(log, rows, axis), content)


def _mode_name(log: Log, mode: int) -> str:
    """Return the label of a mode with a capital letter."""
    label = log.mode_label(mode)
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
    """Return a time, s, as axes of this duration show it: in s, or with minutes and hours."""
    if whole < 120.0:
        return f"{time:.2f}"
    minutes, seconds = divmod(round(time, 1), 60.0)
    if whole < 3600.0:
        return f"{int(minutes)}:{seconds:04.1f}"
    return f"{int(minutes) // 60}:{int(minutes) % 60:02}:{seconds:04.1f}"


def _kept(log: Log, needed: list[int]) -> IntArray:
    """Return the indices of the predictions that the page holds."""
    quantities = [log.crank_angle, *log.natural_frequencies.T, log.peak_magnitude]
    changes = [np.flatnonzero(np.diff(log.status)), np.array(needed, np.int64), log.passes - 1]
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
        assert log.drive is not None
        at = np.searchsorted(log.drive.predictions, rows, side="right") - 1
        r, there = log.resonances.rows(rows), at >= 0
        ratio, part = r.total_load_ratio.astype(np.float32), ~(there & all_counted(log.drive)[at])
        columns["state"] = r.state.astype(np.uint8)
        names = _excitation_names(log)
        columns["excitation"] = np.searchsorted(names, r.excitation).astype(np.uint8)
        columns |= {"load_of": part.astype(np.uint8), "load_ratio": ratio}
        columns["load_known"] = np.where(part, np.float32(np.nan), ratio)
        columns["load_part"] = np.where(part, ratio, np.float32(np.nan))
        parts = ground_and_orders(log.drive, log.excitations) or ()
        for name, values in zip(_PARTS, parts, strict=False):
            columns[name] = np.where(there, values[at], np.nan).astype(np.float32)
        loads, limit = log.drive.resonances.load_ratios, log_limits(log).warning
        for i in range(len(log.drive.names)):
            columns[f"w{i}"] = there * _load_levels(loads[:, i], limit)[at]
    return columns


def _load_levels(ratios: FloatArray, limit: float) -> NDArray[np.uint8]:
    """Return load ratios in steps: 0 unknown, 1 weak, 128 the limit, 255 twice the limit, (n,)."""
    shares = ratios.astype(float) / limit
    above = 128.0 + np.ceil(127.0 * np.minimum(shares - 1.0, 1.0))
    cases = [np.isnan(shares), shares < palette.FAINT, shares <= 1.0]
    steps = np.select(cases, [np.zeros_like(shares), 1.0, 2.0 + np.floor(126.0 * shares)], above)
    return steps.astype(np.uint8)


def _latest(log: Log, flags: BoolArray) -> BoolArray:
    """Return flags of the assessments, (n,), of the latest one at each prediction."""
    assert log.drive is not None
    at = np.searchsorted(log.drive.predictions, np.arange(len(log.stamps)), side="right") - 1
    return np.asarray((at >= 0) & flags[at])


def _excitation_names(log: Log) -> list[str]:
    """Return the names in the resonances, in alphabetical order; the first may be empty."""
    assert log.resonances is not None
    return [str(name) for name in np.unique(log.resonances.excitation)]


def _has_spread(log: Log) -> bool:
    """Return whether the standard deviations contain more than the error of the table."""
    by_table = log.interpolation_error[:, np.newaxis] * log.natural_frequencies
    return bool((log.frequency_stddevs > 1.001 * by_table).any())


def _charts(log: Log, axis: TimeAxis) -> Items:
    """Return the chart of the load, if there are excitations, that of the modes, and the angle."""
    angle = {"column": "crank_angle", "factor": DEG, "colour": palette.INK}
    charts = [] if log.drive is None else [_load_chart(log, log.drive, axis)]
    charts.append(_mode_chart(log))
    charts.append({"id": "angle", "title": "Crank angle α3", "unit": "deg", "series": [angle]})
    shades = (
        ("no prediction", palette.GAP_SHADE, bool(gaps(log))),
        ("angle invalid", palette.INVALID_SHADE, np.isin(log.status, _INVALID).any()),
        ("near a toggle", palette.TOGGLE_SHADE, (log.status == Status.NEAR_TOGGLE).any()),
    )
    key = [
        {"label": name, "colour": colour, "fill": True} for name, colour, shown in shades if shown
    ]
    charts[0] |= {"first": True, "key": [*charts[0].get("key", []), *key]}
    return charts


def _load_chart(log: Log, drive: Drive, axis: TimeAxis) -> dict[str, Any]:
    """Return the chart of the load with its limit; it is hatched where the load is not known."""
    loads, (above, below) = all_counted(drive), above_and_below(drive)
    total = drive.resonances.total_load_ratio.astype(float)
    values = [np.where(loads, total, np.nan), np.where(loads, np.nan, total)]
    parts = ground_and_orders(drive, log.excitations) or ()
    every = (
        *zip(_PARTS.items(), parts, palette.COLOURS[2:4], ("solid", "solid"), strict=False),
        (("load_known", "all sources"), values[0], palette.INK, "solid"),
        (("load_part", "only sources that are known"), values[1], palette.INK, "dotted"),
    )
    lines: Items = [  # A legend names only what is drawn.
        {"column": column, "name": name, "label": name, "colour": colour, "style": style}
        for (column, name), numbers, colour, style in every
        if np.isfinite(numbers).any()
    ]
    key, spans = list(lines), list[list[Any]]()
    marks = (
        ("unknown", "not known whether above the limit", ~_latest(log, above | below)),
        ("above", "above the limit, or tyres off the ground", _latest(log, above)),
    )
    for kind, label, flags in marks:
        places = _spans(log, flags, axis) + (_late(log, axis) if kind == "unknown" else [])
        spans += (its := [[*place, kind] for place in places])
        style = {"colour": _SHADES[kind], "fill": True, "hatched": kind == "unknown"}
        key += [{"label": label, **style}] * bool(its)
    title = "Load ratio: largest force over the static force there"
    chart = {"id": "load", "title": title, "unit": "1", "series": lines, "key": key, "height": 180}
    return chart | {"limit": log_limits(log).warning, "shades": spans}


def _mode_chart(log: Log) -> dict[str, Any]:
    """Return the chart of all modes, over which the page draws the orders."""
    spread, lines = _has_spread(log), Items()
    for mode, colour in enumerate(palette.mode_colours(log.n_modes)):
        line = {"column": f"f{mode + 1}", "colour": colour, "width": 2}
        line |= {"spread": f"s{mode + 1}"} if spread else {}
        line |= {"style": "dashed"} if log.table and log.table.lateral_modes[mode] else {}
        lines.append(line | {"name": log.mode_name(mode) or f"mode {mode + 1}"})
    title, key = "Natural frequencies" + ", with 2 standard deviations" * spread, Items()
    if _excitations_shown(log) and log.drive is not None:
        title += ", and orders"
        orders = log.excitations[: len(log.drive.names)]
        shown = [i for i, each in enumerate(orders) if each.is_order]
        shares = log.drive.resonances.load_ratios[:, shown] / log_limits(log).warning
        weak = {"colour": "#b0b0b0"}
        words = (
            ("as wide as its load", {"colour": palette.INK}, (shares >= palette.FAINT).any()),
            ("above the limit", {"colour": palette.ABOVE}, (shares > 1.0).any()),
            ("weak", weak, (shares < palette.FAINT).any()),
            ("load not known", weak | {"style": "dotted"}, np.isnan(shares).any()),
        )
        key = [{"label": f"order, {word}", **style} for word, style, there in words if there]
    if any("style" in line for line in lines):
        key = [*key, {"label": "sway, roll and yaw", "colour": palette.INK, "style": "dashed"}]
    chart = {"id": "modes", "title": title, "unit": "Hz", "series": lines, "key": key}
    return chart | {"log": True, "height": 380, "orders": True}


def _readings(log: Log) -> Items:
    def reading(name: str, label: str, **more: Any) -> dict[str, Any]:
        return {"id": name, "label": label, **more}

    angle = {"column": "crank_angle", "factor": DEG, "unit": "deg", "digits": 5}
    readings = [
        reading("crank_angle", "Crank angle α3", **angle),
        reading("status", "Status", column="status", words=STATUSES),
    ]
    for mode, colour in enumerate(palette.mode_colours(log.n_modes)):
        name, spread = f"f{mode + 1}", {"spread": f"s{mode + 1}"} if _has_spread(log) else {}
        line = {"colour": colour, "column": name, "unit": "Hz", "digits": 4, **spread}
        line["predicted"] = "peak_magnitude"
        readings.append(reading(name, _mode_name(log, mode), **line))
    digits = 2 if _has_spread(log) else 4  # as many as a mode has
    readings += [
        reading("peak", "FRF peak", column="peak_magnitude", unit="m/N", digits=3),
        reading("peak_f", "FRF peak frequency", column="peak_frequency", unit="Hz", digits=digits),
    ]
    if log.resonances is None:
        return readings
    names = [name or "none" for name in _excitation_names(log)]
    return [
        *readings,
        reading("state", "State", column="state", words=STATES),
        reading("load", "Load ratio", column="load_ratio", digits=2),
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
    """Return the tables of the largest sources, of all of them, and of warnings."""
    if (drive := log.drive) is None:
        return []
    whole, times, severity = float(real_times(log).max()), axis.place(log.times), drive.severity()
    unit = "s" if whole < 120.0 else "min:s" if whole < 3600.0 else "h:min:s"

    def place(message: int) -> dict[str, Any]:
        """Return where the page shows a resonance; the ground has no frequency and no mode."""
        at, prediction = drive.resonances.message(message), int(drive.predictions[message])
        index = int(np.searchsorted(rows, prediction))
        where: dict[str, Any] = {"time": float(times[prediction]), "index": index}
        if not math.isnan(at.natural_frequency):
            where |= {"mode": int(at.mode), "y": float(at.excitation_frequency)}
        return where

    largest, loads, warnings = Items(), Items(), Items()
    described = {each.name: each.description for each in log.excitations}
    for part in parts:
        what, ratio, time = described.get(part.name) or part.name, "not known", ""
        ending, where = "not known", dict[str, Any]()
        if not math.isnan(part.load_ratio):
            time, where = clock(float(drive.times[part.worst]), whole), place(part.worst)
            factors = drive.resonances.load_ratio_factors[part.worst]
            ratio = as_precise(part.load_ratio, float(factors[drive.names.index(part.name)]))
        held = [f"{part.warning_time:.1f}", str(part.warnings), f"{part.note_time:.1f}"]
        held = held if part.known else [""] * len(held)
        loads.append({"cells": [part.name, ratio, time, *held], "length": 0.0, **where})
        if where and part.load_ratio > 0.0 and len(largest) < _SOURCES:
            ending = remedy(log, part.worst)
        elif where or not part.warning_time:
            continue
        # A source of an unknown load that warned, as the ground that tyres left, comes first.
        largest.insert(
            len(largest) if where else 0, {"cells": [what, ratio, time, ending], **where}
        )
    for episode in shown:
        at = drive.resonances.message(episode.worst)
        hertz = at.excitation_frequency
        ratio = as_precise(at.total_load_ratio, at.total_load_ratio_factor)
        ratio = "doubted" if drive.doubted[episode.worst] else ratio
        cells = [clock(episode.start, whole), ratio, at.total_load_place]
        cells += [at.excitation, "" if math.isnan(hertz) else f"{hertz:.1f}"]
        row = {"cells": [*cells, f"{episode.duration:.1f}"], "length": episode.duration}
        row["severity"] = float(severity[episode.worst])
        warnings.append(place(episode.worst) | row)
    unknown = any(math.isnan(part.load_ratio) for part in parts)
    more = f", of which the {MAX_WARNINGS} with the largest loads" * (len(every) > len(shown))
    title, head = "The largest sources" + " that are known" * unknown, ["source", "load ratio [1]"]
    sources = [*head, f"largest at [{unit}]", "what would end it"]
    of_all = [*head, f"at [{unit}]", "in warning [s]", "warnings", "in note [s]"]
    starts = [f"start [{unit}]", head[1], "in", "most severe", "at [Hz]", "duration [s]"]
    tables = (
        ("sources", title, sources, largest[:_SOURCES]),
        ("contributions", f"All sources ({len(loads)})", of_all, loads),
        ("moments", f"Warnings ({len(every)}{more})", starts, warnings),
    )
    return [
        {"id": name, "title": title, "head": head, "rows": rows, "first": name == "sources"}
        for name, title, head, rows in tables
    ]


def as_precise(ratio: float, factor: float) -> str:
    """Return a load ratio without digits below its standard deviation, a factor, or with two."""
    if not ratio > 0.0 or not math.isfinite(ratio):
        return "not known" if math.isnan(ratio) else f"{ratio:.2g}"
    last = math.floor(math.log10(ratio)) - 1
    if factor > 1.0:
        last = max(last, min(math.floor(math.log10(ratio * (factor - 1.0))), last + 1))
    return f"{round(ratio, -last):.{max(0, -last)}f}"


def _summary(log: Log, of: dict[str, Any], missing: list[tuple[float, float]]) -> list[list[str]]:
    """Return labels and values that no chart shows, of values of `drive_summary`."""
    length = f"{len(missing)}, {_span(sum(end - start for start, end in missing))} in total"
    rows = [
        ["Drive", f"{_span(log.times[-1])}, {of['predictions']:,} predictions"],
        ["Predictions not OK", f"{of['not_ok']:,}"],
        ["Gaps", length if missing else "none"],
    ]
    overdamped = np.isnan(log.natural_frequencies[np.isfinite(log.peak_magnitude)]).sum(axis=0)
    for mode in np.flatnonzero(overdamped).tolist():
        text = f"overdamped in {overdamped[mode]:,} predictions"
        rows.append([_mode_name(log, mode), text])
    if (worst := of["worst"]) is not None:
        load = f"{ratio_words(worst['load_ratio'])} in {worst['place'] or 'the pins'}"
        angle = math.radians(worst["crank_angle_deg"] or math.nan)
        rows.append(["Largest load", f"{load}{_static_force(log, worst['place'], angle)}"])
    if reason := of["model"]["unknown_deviations"]:
        rows.append(["Standard deviations", reason])
    if len(log.passes):
        back = real_times(log)[log.passes - 1] - real_times(log)[log.passes]
        text = f"{len(back)} times, by up to {_span(float(back.max()))}"
        rows.append(["The clock jumped back", text])
    return rows


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


def _provenance(
    log: Log, summary: dict[str, Any], missing: list[tuple[float, float]], n_kept: int
) -> dict[str, Any]:
    n = len(log.stamps)
    text = f"all {n:,} predictions"
    if n_kept < n:
        text = f"{n_kept:,} of {n:,} predictions, with the extremes of every stretch"
    exact = "times and angles are exact, other numbers have 7 digits"
    rows = [*_summary(log, summary, missing), *provenance_rows(log)]
    texts = {"Parameters": log.parameters_text, "Mechanism": log.mechanism_text}
    files = [{"name": name, "text": text} for name, text in texts.items() if text]
    return {"rows": [*rows, ["This page holds", f"{text}; {exact}"]], "files": files}


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


def _late(log: Log, axis: TimeAxis) -> list[list[float]]:
    """Return from where to where on the axis the next message is so late that none holds."""
    assert log.drive is not None
    times = log.times[log.drive.predictions]
    late = np.flatnonzero(np.diff(times) > GAP)
    ends = np.stack([times[late] + log.drive.held[late], times[late + 1]], axis=1)
    places: list[list[float]] = axis.place(ends).tolist()
    return places


def _spans(log: Log, flags: BoolArray, axis: TimeAxis) -> list[list[float]]:
    """Return from where to where on the axis flags of predictions, (n,), are true."""
    times = axis.place(log.times)
    return [times[[start, min(end, len(times) - 1)]].tolist() for start, end in runs(flags)]


def _excitations(log: Log, axis: TimeAxis) -> dict[str, Any]:
    """Return the speeds, and of each excitation the ratio of its frequency, Hz, to its speed."""
    shown, speeds = _excitations_shown(log), dict[str, Any]()
    for source, (times, values) in all_speeds(log).items():
        fixed = {"fixed": float(values[0])}  # at all times of the page
        measured = {"times": axis.place(times), "values": values.astype(np.float32)}
        if any(each.source is source for each in shown):
            speeds[source.value] = measured if source in log.speeds else fixed
    return {
        "speeds": speeds,
        "excitations": [
            {
                "name": each.name,
                "load": f"w{log.excitations.index(each)}",
                "source": each.source.value,
                "ratio": each.ratio,
            }
            for each in shown
        ],
    }


def _excitations_shown(log: Log) -> list[Excitation]:
    """Return the orders whose speed was known for some time."""
    stale = number(log, "stale_after", _STALE_AFTER)
    known = {
        source
        for source, (times, _) in all_speeds(log).items()
        if source not in log.speeds or (np.diff(times) <= stale).any()
    }
    return [each for each in log.excitations if each.source in known and each.is_order]
