# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A log as a page to look into."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.drawing.intervals import runs
from linkage_vibration.drawing.palette import (
    COLOURS,
    GAP_SHADE,
    INK,
    INVALID_SHADE,
    PEAK,
    TOGGLE_SHADE,
    mode_colours,
)
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.resonance import ResonanceState
from linkage_vibration.review.html import (
    Page,
    packed,
    thinned,
)
from linkage_vibration.review.log import Log, durations, gaps
from linkage_vibration.review.model_grid import Drawing, FrfTerms, drawing, frf_terms
from linkage_vibration.review.moments import (
    MAX_MOMENTS,
    Moment,
    angle_shares,
    margin_shares,
    moments,
    worst,
)
from linkage_vibration.table.table import Table

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MARGIN = COLOURS[0]
DEG = 180.0 / math.pi
STATUSES = ["OK", "out of range", "angle is no number", "near a toggle"]
STATES = ["clear", "warning", "not known"]
_STYLES = {Source.ENGINE: "solid", Source.PTO: "dashed", Source.GROUND: "dotted"}
_STALE_AFTER = 1.0  # s, where the log does not tell


def review_page(log: Log) -> Page:
    """Return what a page shows of a log."""
    found = moments(log)
    shown = worst(found)
    rows = _kept(log, shown)
    place = {int(row): i for i, row in enumerate(rows)}
    missing = gaps(log)
    begins = np.searchsorted(log.times[rows], [end for _, end in missing])
    terms = frf_terms(log.mechanism, log.table) if log.mechanism and log.table else None
    drawn = drawing(log.mechanism, log.table) if log.mechanism and log.table else None
    limit = log.parameters.get("warning_margin")
    margin = float(limit) if isinstance(limit, int | float) else None
    content: dict[str, Any] = {
        "charts": _charts(log, margin),
        "overview": {"column": "crank_angle", "factor": DEG, "label": "α3"},
        "readings": _readings(log),
        "brief": ["crank_angle", *(f"f{mode + 1}" for mode in range(log.n_modes))],
        "tables": [_moments_table(log, found, shown, place)],
        "summary": _summary(log, found, missing),
        "histograms": _histograms(log, margin),
        "provenance": _provenance(log, len(rows)),
        "shades": _shades(log, missing),
        "excitations": _excitations(log, rows),
        "stale_after": _number(log, "stale_after", _STALE_AFTER),
    }
    if terms is not None and log.table is not None:
        content["frf"] = _frf(terms, log.table)
    if drawn is not None:
        content["linkage"] = _linkage(drawn)
    name = log.table.mechanism_name.replace("_", " ") if log.table else "the linkage"
    return Page(
        title=f"Vibration review: {name}",
        subtitle=f"{log.path.name}: {len(log.stamps):,} predictions of table {log.table_id}",
        columns=_columns(log, rows),
        start_ns=int(log.stamps[0]),
        breaks=[int(i) for i in begins],
        modes=mode_colours(log.n_modes),
        content=content,
    )


def _kept(log: Log, shown: list[Moment]) -> IntArray:
    """Return which predictions the page holds."""
    quantities = [log.crank_angle, *log.natural_frequencies.T, log.peak_magnitude]
    changes = [np.flatnonzero(np.diff(log.status)), [moment.nearest for moment in shown]]
    changes += [np.searchsorted(log.times, [a for a, _ in gaps(log)])]
    if log.resonances is not None:
        quantities.append(log.resonances.relative_margin)
        changes.append(np.flatnonzero(np.diff(log.resonances.state)))
    edges = np.concatenate([np.asarray(some, dtype=np.int64) for some in changes])
    return thinned(quantities, np.union1d(edges, np.minimum(edges + 1, len(log.stamps) - 1)))


def _columns(log: Log, rows: IntArray) -> dict[str, NDArray[Any]]:
    columns: dict[str, NDArray[Any]] = {
        "time": log.times[rows],
        "crank_angle": log.crank_angle[rows],
        "status": log.status[rows].astype(np.uint8),
        "peak_frequency": log.peak_frequency[rows].astype(np.float32),
        "peak_magnitude": log.peak_magnitude[rows].astype(np.float32),
        "interpolation_error": log.interpolation_error[rows].astype(np.float32),
    }
    for mode in range(log.n_modes):
        columns[f"f{mode + 1}"] = log.natural_frequencies[rows, mode]
        columns[f"s{mode + 1}"] = log.frequency_stddev[rows, mode].astype(np.float32)
    if log.resonances is not None:
        r = log.resonances
        names = _excitation_names(log)
        columns["state"] = r.state[rows].astype(np.uint8)
        columns["excitation"] = np.searchsorted(names, r.excitation[rows]).astype(np.uint8)
        columns["excitation_frequency"] = r.excitation_frequency[rows].astype(np.float32)
        columns["margin"] = r.relative_margin[rows].astype(np.float32)
        columns["resonance_mode"] = (r.mode[rows] + 1).astype(np.uint8)
    return columns


def _excitation_names(log: Log) -> list[str]:
    """Return the names that resonances have, in alphabetical order; the first may be empty."""
    assert log.resonances is not None
    return [str(name) for name in np.unique(log.resonances.excitation)]


def _has_spread(log: Log) -> bool:
    return bool(np.nanmax(log.frequency_stddev, initial=0.0) > 0.0)


def _charts(log: Log, margin: float | None) -> list[dict[str, Any]]:
    spread = _has_spread(log)
    shades = [
        {"label": label, "colour": colour, "fill": True}
        for label, colour, shown in (
            ("no prediction", GAP_SHADE, bool(gaps(log))),
            (
                "angle out of range or no number",
                INVALID_SHADE,
                bool(np.isin(log.status, (1, 2)).any()),
            ),
            ("near a toggle", TOGGLE_SHADE, bool((log.status == Status.NEAR_TOGGLE).any())),
        )
        if shown
    ]
    charts: list[dict[str, Any]] = [
        {
            "id": "angle",
            "title": "Crank angle α3",
            "unit": "deg",
            "series": [{"column": "crank_angle", "factor": DEG, "colour": INK}],
            "key": shades,
        }
    ]
    for mode, colour in enumerate(mode_colours(log.n_modes)):
        line: dict[str, Any] = {"column": f"f{mode + 1}", "colour": colour, "width": 2}
        key: list[dict[str, Any]] = []
        if spread:
            line["spread"] = f"s{mode + 1}"
            key.append({"label": "± 2 standard deviations", "colour": f"{colour}40", "fill": True})
        key += [{"label": "excitations", "colour": "#555555"}]
        charts.append(
            {
                "id": f"f{mode + 1}",
                "title": f"Natural frequency of mode {mode + 1}",
                "unit": "Hz",
                "mode": mode,
                "series": [line],
                "key": key,
            }
        )
    charts.append(
        {
            "id": "peak",
            "title": "FRF peak",
            "unit": "m/N",
            "log": True,
            "series": [{"column": "peak_magnitude", "colour": PEAK, "width": 1.8}],
        }
    )
    if log.resonances is not None:
        guides = [] if margin is None else [100.0 * margin, 0.0, -100.0 * margin]
        charts.append(
            {
                "id": "margin",
                "title": "Nearest excitation, from its natural frequency",
                "unit": "%",
                "series": [{"column": "margin", "factor": 100.0, "colour": MARGIN}],
                "guides": guides,
                "key": [{"label": "warning", "colour": "#5f5f5f", "style": "dashed"}]
                if guides
                else [],
            }
        )
    return charts


def _readings(log: Log) -> list[dict[str, Any]]:
    spread = _has_spread(log)
    readings: list[dict[str, Any]] = [
        {
            "id": "crank_angle",
            "label": "Crank angle α3",
            "column": "crank_angle",
            "factor": DEG,
            "unit": "deg",
            "digits": 8,
        },
        {"id": "status", "label": "Status", "column": "status", "words": STATUSES},
    ]
    for mode, colour in enumerate(mode_colours(log.n_modes)):
        reading: dict[str, Any] = {
            "id": f"f{mode + 1}",
            "label": f"Mode {mode + 1}",
            "colour": colour,
            "column": f"f{mode + 1}",
            "unit": "Hz",
            "digits": 8,
        }
        if spread:
            reading["spread"] = f"s{mode + 1}"
        readings.append(reading)
    readings += [
        {"id": "peak", "label": "FRF peak", "column": "peak_magnitude", "unit": "m/N"},
        {"id": "peak_f", "label": "FRF peak at", "column": "peak_frequency", "unit": "Hz"},
        {"id": "error", "label": "Table's error", "column": "interpolation_error", "digits": 2},
    ]
    if log.resonances is not None:
        names = [name or "none" for name in _excitation_names(log)]
        readings += [
            {"id": "state", "label": "Resonance", "column": "state", "words": STATES},
            {
                "id": "excitation",
                "label": "Nearest excitation",
                "column": "excitation",
                "words": names,
            },
            {"id": "exc_f", "label": "Its frequency", "column": "excitation_frequency"}
            | {"unit": "Hz"},
            {
                "id": "near_mode",
                "label": "Nearest mode",
                "column": "resonance_mode",
                "digits": 1,
            },
            {"id": "margin", "label": "Margin", "column": "margin", "factor": 100.0}
            | {"unit": "%", "digits": 4},
        ]
    return readings


def _moments_table(
    log: Log, found: list[Moment], shown: list[Moment], place: dict[int, int]
) -> dict[str, Any]:
    if log.resonances is None:
        note = "The log holds no resonances: no speed of engine, PTO or ground was known."
    elif not found:
        note = "No excitation came near a natural frequency."
    else:
        note = "An excitation near a natural frequency, at its nearest. Choose one to go there."
        if len(found) > len(shown):
            note += f" The {MAX_MOMENTS} nearest of {len(found)}."
    times = log.times
    rows = [
        {
            "cells": [
                clock(float(times[m.nearest]), float(times[-1])),
                m.excitation,
                str(m.mode + 1),
                f"{m.natural_frequency:.2f}",
                f"{100.0 * m.relative_margin:+.1f}" + (" ×" if m.crossed else ""),
                f"{m.end - m.start:.2f}",
            ],
            "time": float(times[m.nearest]),
            "length": m.end - m.start,
            "index": place[m.nearest],
            "mode": m.mode,
            "y": m.natural_frequency,
            "margin": m.relative_margin,
        }
        for m in shown
    ]
    if any(m.crossed for m in shown):
        note += " × marks those that passed each other."
    head = ["time", "excitation", "mode", "at Hz", "margin %", "for s"]
    title = f"Moments of resonance ({len(found)})"
    return {"id": "moments", "title": title, "note": note, "head": head, "rows": rows}


def clock(time: float, whole: float) -> str:
    """Return a time as the page's axes tell it: s, or with minutes and hours in long logs."""
    if whole < 120.0:
        return f"{time:.2f}"
    minutes, seconds = divmod(round(time, 1), 60.0)
    if whole < 3600.0:
        return f"{int(minutes)}:{seconds:04.1f}"
    return f"{int(minutes) // 60}:{int(minutes) % 60:02}:{seconds:04.1f}"


def _summary(
    log: Log, found: list[Moment], missing: list[tuple[float, float]]
) -> list[dict[str, Any]]:
    held = durations(log)
    total = float(held.sum()) or 1.0
    sound = np.isfinite(log.natural_frequencies[:, 0])
    faulty = int((log.status != Status.OK).sum())
    items: list[dict[str, Any]] = [
        {"label": "Drive", "value": f"{_span(log.times[-1])}, {len(log.stamps):,} predictions"}
    ]
    if sound.any():
        angles = log.crank_angle[sound] * DEG
        items.append(
            {"label": "Crank angle", "value": f"{angles.min():.1f} to {angles.max():.1f} deg"}
        )
        for mode in range(log.n_modes):
            some = log.natural_frequencies[sound, mode]
            items.append(
                {"label": f"Mode {mode + 1}", "value": f"{some.min():.2f} to {some.max():.2f} Hz"}
            )
        peak = int(np.nanargmax(log.peak_magnitude))
        items.append(
            {
                "label": "Highest FRF peak",
                "value": f"{log.peak_magnitude[peak]:.3g} m/N at {log.peak_frequency[peak]:.2f} Hz",
            }
        )
    if log.resonances is not None:
        warning = float(held[log.resonances.state == ResonanceState.WARNING].sum())
        items.append(
            {
                "label": "Resonance warnings",
                "value": f"{len(found)}, {100.0 * warning / total:.1f} % of the time",
                "alert": bool(found),
            }
        )
    items += [
        {
            "label": "Predictions not OK",
            "value": f"{faulty:,}" if faulty else "none",
            "alert": faulty > 0,
        },
        {
            "label": "Gaps",
            "value": f"{len(missing)}, {_span(sum(b - a for a, b in missing))} in all"
            if missing
            else "none",
            "alert": bool(missing),
        },
    ]
    return items


def _span(seconds: float) -> str:
    """Return a length of time in the unit that people would choose."""
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    return f"{seconds / 60.0:.1f} min" if seconds < 3600.0 else f"{seconds / 3600.0:.2f} h"


def _histograms(log: Log, margin: float | None) -> list[dict[str, Any]]:
    angles, margins = angle_shares(log), margin_shares(log)
    found: list[dict[str, Any]] = [
        {
            "title": "Time over the crank angle",
            "unit": "crank angle [deg]",
            "edges": (angles.edges * DEG).tolist(),
            "shares": angles.shares.tolist(),
            "limit": None,
        }
    ]
    if margins is not None:
        note = "The last bar holds all that is larger."
        if margin is not None:
            note += f" Orange: below the warning margin of {100.0 * margin:g} %."
        found.append(
            {
                "title": "Time over the margin to the nearest resonance",
                "unit": "margin [%]",
                "edges": (100.0 * margins.edges).tolist(),
                "shares": margins.shares.tolist(),
                "limit": None if margin is None else 100.0 * margin,
                "note": note,
            }
        )
    return found


def provenance_rows(log: Log) -> list[list[str]]:
    """Return what made a log, in words."""
    rows = [["Log", log.path.name], ["Table", log.table_id]]
    if log.table is not None:
        table = log.table
        low, high = (DEG * angle for angle in table.alpha3_range)
        rows += [
            ["Mechanism", f"{table.mechanism_name}, model {table.model_hash[:12]}"],
            ["Range of angles", f"{low:g} to {high:g} deg"],
            ["Band of frequencies", f"{table.band[0]:g} to {table.band[1]:g} Hz"],
            [
                "Table's relative error",
                f"natural frequencies {table.interpolation_error.max():.1e}, FRF peak "
                f"{table.peak_error:.1e}, FRFs {table.frf_error:.1e}; measured against the model",
            ],
            ["Table built by", f"linkage_vibration {table.package_version}"],
        ]
    else:
        rows.append(["Model", "the log does not hold the table that made it"])
    for name, record in log.metadata.items():
        if name != "rosbag2" and record:
            told = ", ".join(f"{key} {value}" for key, value in record.items())
            rows.append([f"Record {name}", told])
    return rows


def _provenance(log: Log, n_kept: int) -> dict[str, Any]:
    rows = provenance_rows(log)
    n = len(log.stamps)
    told = f"all {n:,} predictions" if n_kept == n else f"{n_kept:,} of {n:,} predictions"
    if n_kept < n:
        told += ", with the extremes of every stretch"
    rows.append(["This page holds", f"{told}; angles and frequencies as they are in the log"])
    files = [
        {"name": name, "text": text}
        for name, text in (
            ("Parameters", log.parameters_text),
            ("Mechanism", log.mechanism_text),
        )
        if text
    ]
    return {"title": "What made this log", "rows": rows, "files": files}


def _shades(log: Log, missing: list[tuple[float, float]]) -> list[list[Any]]:
    times = log.times
    kinds = (
        ("range", np.isin(log.status, (Status.OUT_OF_RANGE, Status.INVALID_ANGLE))),
        ("toggle", log.status == Status.NEAR_TOGGLE),
    )
    shades: list[list[Any]] = [[start, end, "gap"] for start, end in missing]
    for kind, flags in kinds:
        for start, end in runs(flags):
            shades.append([float(times[start]), float(times[min(end, len(times) - 1)]), kind])
    return shades


def _excitations(log: Log, rows: IntArray) -> list[dict[str, Any]]:
    """Return each excitation over time; of those that the log does not describe, where nearest."""
    found = []
    speeds = dict(log.speeds)
    for source in Source:
        fixed = _number(log, f"{source.value}_speed", -1.0)
        if fixed > 0.0:
            speeds[source] = np.array([0.0, log.times[-1]]), np.array([fixed, fixed])
    for excitation in log.excitations:
        if excitation.source in speeds:
            times, values = speeds[excitation.source]
            style = _STYLES[excitation.source]
            found.append(_line(excitation.name, style, times, excitation.ratio * values))
    if log.excitations or log.resonances is None:
        return found
    nearest, times = log.resonances.excitation[rows], log.times[rows]
    for name in _excitation_names(log):
        own = nearest == name
        if name:
            near = own | np.append(False, own[:-1])  # one behind each run, to end its line
            values = np.where(own, log.resonances.excitation_frequency[rows], np.nan)
            found.append(_line(name, "solid", times[near], values[near]))
    return found


def _line(name: str, style: str, times: FloatArray, values: FloatArray) -> dict[str, Any]:
    told = {"times": packed(times), "values": packed(values.astype(np.float32))}
    return {"name": name, "style": style, **told}


def _frf(terms: FrfTerms, table: Table) -> dict[str, Any]:
    frequencies = table.evaluate(terms.angles)[:, : table.n_modes]
    return {
        "place": terms.place,
        "band": list(terms.band),
        "n_terms": terms.terms.shape[1],
        "angles": packed(terms.angles),
        "terms": packed(terms.terms),
        "residual": packed(terms.residual),
        "frequencies": packed(frequencies),
    }


def _linkage(drawn: Drawing) -> dict[str, Any]:
    return {
        "bodies": list(drawn.bodies),
        "rigid": list(drawn.rigid),
        "lengths": list(drawn.lengths),
        "size": drawn.size,
        "angles": packed(drawn.angles),
        **{
            name: packed(getattr(drawn, name).astype(np.float32))
            for name in ("places", "shapes", "joints", "centres", "ground")
        },
    }


def _number(log: Log, name: str, default: float) -> float:
    value = log.parameters.get(name, default)
    return float(value) if isinstance(value, int | float) else default
