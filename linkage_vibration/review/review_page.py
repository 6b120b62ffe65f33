# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Describes the page of one log: its charts, readings, tables and texts."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.drawing import palette
from linkage_vibration.drawing.intervals import runs
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.predictor import Status, uncertain_modes
from linkage_vibration.prediction.resonance import ResonanceState
from linkage_vibration.review.campbell import campbell
from linkage_vibration.review.findings import (
    Meeting,
    amplification,
    first_sentence,
    limit_margin,
    meetings,
    real_times,
)
from linkage_vibration.review.html import Page, thinned
from linkage_vibration.review.log import Log, durations, gaps
from linkage_vibration.review.model_grid import linkage_grid, receptance_grid
from linkage_vibration.review.moments import (
    MAX_MOMENTS,
    Moment,
    Shares,
    angle_shares,
    margin_shares,
    moments,
    worst,
)
from linkage_vibration.review.time_axis import TimeAxis, time_axis

IntArray = NDArray[np.int64]
Items = list[dict[str, Any]]  # as the scripts of the page read them

DEG = 180.0 / math.pi
STATUSES = ["OK", "out of range", "invalid angle", "near a toggle"]
STATES = ["clear", "warning", "unknown", "note"]
_STYLES = {Source.ENGINE: "solid", Source.PTO: "dashed", Source.GROUND: "dotted"}
_INVALID = (Status.OUT_OF_RANGE, Status.INVALID_ANGLE)
MAX_MEETINGS = 6  # rows of the table of excitations and modes
_NEARLY_ALL = 0.999  # a smaller share of known resonances is mentioned
_STALE_AFTER = 1.0  # s, if the log does not hold this parameter


def review_page(log: Log) -> Page:
    """Return what a page shows of a log."""
    all_moments = moments(log)
    shown, met = worst(all_moments), meetings(log, all_moments)
    rows = _kept(log, [moment.nearest for moment in shown] + [meeting.strongest for meeting in met])
    missing, axis, margin = gaps(log), time_axis(log), limit_margin(log)
    content: dict[str, Any] = {
        "charts": _charts(log, margin),
        "overview": {"column": "crank_angle", "factor": DEG, "label": "α3"},
        "readings": _readings(log),
        "mode_labels": [_mode_name(log, mode) for mode in range(log.n_modes)],
        "brief": ["crank_angle", *(f"f{mode + 1}" for mode in range(log.n_modes))],
        "answer": first_sentence(log, met),
        "tables": [
            *_meetings_table(log, met, rows, axis),
            _moments_table(log, all_moments, shown, rows, axis),
        ],
        "summary": _summary(log, all_moments, missing),
        "histograms": _histograms(log, margin),
        "provenance": _provenance(log, len(rows)),
        "shades": _shades(log, missing, axis),
        "excitations": _excitations(log, rows, axis),
        "clock": axis.knots(),
        "campbell": campbell(log, all_moments),
        "stale_after": _number(log, "stale_after", _STALE_AFTER),
    }
    if log.mechanism and log.table:
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
        modes=palette.mode_colours(log.n_modes),
        content=content,
    )


def _mode_name(log: Log, mode: int) -> str:
    """Return how the page calls a mode: its number, and its name if the log has its table."""
    label = log.mode_label(mode)
    return label[0].upper() + label[1:]


def _numbered(log: Log, mode: int) -> str:
    """Return the number of a mode, and its name if the log has its table."""
    return log.mode_label(mode).removeprefix("mode ")


def provenance_rows(log: Log) -> list[list[str]]:
    """Return what made a log, as pairs of a label and a text."""
    rows = [["Log", log.path.name], ["Table", log.table_id]]
    if log.table is not None:
        table = log.table
        low, high = (DEG * angle for angle in table.alpha3_range)
        errors = (
            f"natural frequencies and damping ratios {table.interpolation_error.max():.1e}, "
            f"FRF peak {table.peak_error:.1e}, FRFs {table.frf_error:.1e}, slopes "
            f"{table.slope_error:.1e} per rad; bounds against the model"
        )
        rows += [
            ["Mechanism", f"{table.mechanism_name}, model {table.model_hash[:12]}"],
            ["Range of angles", f"{low:g} to {high:g} deg"],
            ["Frequency band", f"{table.band[0]:g} to {table.band[1]:g} Hz"],
            ["Relative error of the table", errors],
            ["Table built by", f"linkage_vibration {table.package_version}"],
        ]
    else:
        rows.append(["Model", "the log does not hold the table that made it"])
    for name, record in log.metadata.items():
        if name != "rosbag2" and record:
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
        quantities.append(log.resonances.relative_margin)
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
        "interpolation_error": log.interpolation_error[rows].astype(np.float32),
    }
    if not np.array_equal(log.table_angle, log.crank_angle, equal_nan=True):
        columns["table_angle"] = log.table_angle[rows]
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
    """Return the names in the resonances, in alphabetical order; the first may be empty."""
    assert log.resonances is not None
    return [str(name) for name in np.unique(log.resonances.excitation)]


def _has_spread(log: Log) -> bool:
    """Return whether the standard deviations contain more than the error of the table."""
    by_table = log.interpolation_error[:, np.newaxis] * log.natural_frequencies
    return bool((log.frequency_stddev > 1.001 * by_table).any())


def _charts(log: Log, margin: float | None) -> Items:
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
    if log.resonances is not None:
        title = "Margin of the nearest excitation to its natural frequency"
        series = [{"column": "margin", "factor": 100.0, "colour": palette.COLOURS[0]}]
        guides = [] if margin is None else [100.0 * margin, 0.0, -100.0 * margin]
        key = [{"label": "warning", "colour": "#5f5f5f", "style": "dashed"}] if guides else []
        charts.append(chart("margin", title, "%", series=series, guides=guides, key=key))
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
        line = {"colour": colour, "column": name, "unit": "Hz", "digits": 8, **spread}
        line["predicted"] = "peak_magnitude"
        readings.append(reading(name, _mode_name(log, mode), **line))
    readings += [
        reading("peak", "FRF peak", column="peak_magnitude", unit="m/N"),
        reading("peak_f", "FRF peak frequency", column="peak_frequency", unit="Hz"),
        reading("error", "Error of the table", column="interpolation_error", digits=2),
    ]
    if log.resonances is None:
        return readings
    names = [name or "none" for name in _excitation_names(log)]
    near = ["none", *(_numbered(log, mode) for mode in range(log.n_modes))]
    return [
        *readings,
        reading("state", "Resonance", column="state", words=STATES),
        reading("excitation", "Most severe excitation", column="excitation", words=names),
        reading("exc_f", "Excitation frequency", column="excitation_frequency", unit="Hz"),
        reading("near_mode", "Nearest mode", column="resonance_mode", words=near),
        reading("margin", "Margin", column="margin", factor=100.0, unit="%", digits=4),
    ]


def _meetings_table(log: Log, met: list[Meeting], rows: IntArray, axis: TimeAxis) -> Items:
    """Return the table of excitations and modes that met; none if none did."""
    if not met:
        return []
    times, places, lines = real_times(log), axis.place(log.times), []
    for meeting in met[:MAX_MEETINGS]:
        index = int(np.searchsorted(rows, meeting.strongest))
        spread = (
            ""
            if math.isnan(meeting.amplification_stddev)
            else f" ± {meeting.amplification_stddev:.2g}"
        )
        cells = [
            meeting.excitation,
            _numbered(log, meeting.mode),
            f"{meeting.amplification:.3g}{spread}",
        ]
        at = clock(float(times[meeting.strongest]), float(times.max()))
        cells += [f"{meeting.dwell:.2f}", str(meeting.count), at, meeting.avoid]
        length = meeting.worst.end - meeting.worst.start
        place = {"time": float(places[meeting.strongest]), "index": index, "mode": meeting.mode}
        lines.append({"cells": cells, "length": length, **place})
    note = "Each row is an excitation and a mode at its strongest moment. Choose a row to go there."
    if any(math.isnan(meeting.amplification_stddev) for meeting in met):
        note += " Amplifications without ± have a standard deviation that is not known."
    if len(met) > MAX_MEETINGS:
        note += f" Of {len(met)} pairs, the {MAX_MEETINGS} with the highest amplification."
    head = ["excitation", "mode", "amplified (times)", "total s", "moments", "worst at", "avoid"]
    title = "What met, the worst first"
    table = {"id": "meetings", "title": title, "note": note, "head": head, "rows": lines}
    return [table | {"first": True}]


def _moments_table(
    log: Log, all_moments: list[Moment], shown: list[Moment], rows: IntArray, axis: TimeAxis
) -> dict[str, Any]:
    if log.resonances is None:
        note = "The log holds no resonances, as no speed of engine, PTO or ground was known."
    elif not all_moments:
        note = "No excitation came near a natural frequency."
    else:
        note = "Each row is a warning at its smallest margin. Choose a row to go there."
        if len(all_moments) > len(shown):
            note += f" Of {len(all_moments)} warnings, the {MAX_MOMENTS} with the smallest margins."
    if any(m.crossed for m in shown):
        note += " × marks a crossing."
    times, real, lines = axis.place(log.times), real_times(log), []
    strength = amplification(log, all_moments)
    for m in shown:
        time, length = float(times[m.nearest]), m.end - m.start
        severity = float(strength[m.first : m.last + 1].max())
        margin = f"{100.0 * m.relative_margin:+.1f}" + (" ×" if m.crossed else "")
        cells = [
            clock(float(real[m.nearest]), float(real.max())),
            m.excitation,
            _numbered(log, m.mode),
        ]
        cells += [f"{m.natural_frequency:.2f}", margin, f"{severity:.3g}", f"{length:.2f}"]
        index = int(np.searchsorted(rows, m.nearest))
        at = {"cells": cells, "time": time, "length": length, "index": index, "mode": m.mode}
        at |= {"y": m.natural_frequency, "margin": m.relative_margin, "severity": severity}
        lines.append(at)
    head = ["time", "excitation", "mode", "Hz", "margin %", "amplified", "duration s"]
    title = f"Single moments of resonance ({len(all_moments)})"
    table = {"id": "moments", "title": title, "note": note, "head": head, "rows": lines}
    return table | {"folded": True}


def _summary(log: Log, all_moments: list[Moment], missing: list[tuple[float, float]]) -> Items:
    items: Items = []

    def add(label: str, value: str, **alert: bool) -> None:
        items.append({"label": label, "value": value, **alert})

    held = durations(log)
    add("Drive", f"{_span(log.times[-1])}, {len(log.stamps):,} predictions")
    valid = np.isfinite(log.peak_magnitude)
    if valid.any():
        angles = log.crank_angle[valid] * DEG
        add("Crank angle", f"{angles.min():.1f} to {angles.max():.1f} deg")
        for mode, values in enumerate(log.natural_frequencies[valid].T):
            oscillating = values[np.isfinite(values)]
            overdamped = f"overdamped in {len(values) - len(oscillating):,} predictions"
            parts = [overdamped] if len(oscillating) < len(values) else []
            if len(oscillating):
                parts.insert(0, f"{oscillating.min():.2f} to {oscillating.max():.2f} Hz")
            add(_mode_name(log, mode), ", ".join(parts))
        peak = int(np.nanargmax(log.peak_magnitude))
        height, frequency = log.peak_magnitude[peak], log.peak_frequency[peak]
        add("Highest FRF peak", f"{height:.3g} m/N at {frequency:.2f} Hz")
    if log.resonances is not None:
        warning = float(held[log.resonances.state == ResonanceState.WARNING].sum())
        share = 100.0 * warning / (float(held.sum()) or 1.0)
        assessed = held[log.resonances.state != ResonanceState.STALE].sum() / (held.sum() or 1.0)
        text = f"{len(all_moments)}, {share:.1f} % of the time"
        if not assessed:
            text = "not known"
        elif assessed < _NEARLY_ALL:
            text += f"; not known for {100.0 * (1.0 - assessed):.1f} %"
        add("Resonance warnings", text, alert=bool(all_moments) or not assessed)
        total = log.resonances.total_velocity
        if np.isfinite(total).any():
            at = int(np.nanargmax(total))
            spread = 1e3 * float(log.resonances.total_velocity_stddev[at])
            text = "not known" if math.isnan(spread) else f"{spread:.2g} mm/s"
            text = f"{1e3 * total[at]:.3g} mm/s rms, standard deviation {text}"
            add("Strongest vibration", f"{text}, for the amplitudes that the excitations state")
    else:
        add("Resonance warnings", "not known", alert=True)
    deviations = log.frequency_stddev, log.damping_ratios, log.damping_ratio_stddev
    expected = log.table is not None and log.table.uncertain  # numbers of the mechanism are
    uncertain = uncertain_modes(log.natural_frequencies, *deviations, log.mode_label)
    if expected and uncertain:
        add("Uncertain modes", f"{len(uncertain)} of {log.n_modes}: {_largest_deviations(log)}")
    else:
        for text in uncertain:
            add("Uncertain", text, alert=True)
    faulty = int((log.status != Status.OK).sum())
    add("Predictions not OK", f"{faulty:,}" if faulty else "none", alert=faulty > 0)
    length = f"{len(missing)}, {_span(sum(end - start for start, end in missing))} in total"
    add("Gaps", length if missing else "none", alert=bool(missing))
    if len(log.passes):
        back = real_times(log)[log.passes - 1] - real_times(log)[log.passes]
        text = f"{len(back)} times, by up to {_span(float(back.max()))}"
        add("The clock jumped back", text, alert=True)
    return items


def _largest_deviations(log: Log) -> str:
    """Return the largest relative standard deviations of the modes in words."""
    largest = []
    for values, stddev in (
        (log.natural_frequencies, log.frequency_stddev),
        (log.damping_ratios, log.damping_ratio_stddev),
    ):
        shares = np.divide(stddev, values, out=np.zeros(values.shape), where=values > 0.0)
        largest.append(100.0 * float(np.fmax.reduce(shares, axis=None, initial=0.0)))
    return f"standard deviation up to {largest[0]:.2g} % (frequency), {largest[1]:.2g} % (damping)"


def _span(seconds: float) -> str:
    """Return a duration in s, min or h."""
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    return f"{seconds / 60.0:.1f} min" if seconds < 3600.0 else f"{seconds / 3600.0:.2f} h"


def _histograms(log: Log, margin: float | None) -> Items:
    def histogram(name: str, unit: str, shares: Shares, scale: float) -> dict[str, Any]:
        edges, heights = shares[0] * scale, shares[1]
        texts = {"title": f"Share of time over the {name}", "unit": unit}
        return {**texts, "edges": edges.tolist(), "shares": heights.tolist(), "limit": None}

    plots = [histogram("crank angle", "crank angle [deg]", angle_shares(log), DEG)]
    margins = margin_shares(log)
    if margins is not None:
        note = "The last bar includes all larger margins."
        limit = None if margin is None else 100.0 * margin
        if limit is not None:
            note += f" Bars below the warning margin of {limit:g} % are orange."
        name = "margin to the nearest resonance"
        bars = histogram(name, "margin [%]", margins, 100.0)
        plots.append(bars | {"limit": limit, "note": note})
    return plots


def _provenance(log: Log, n_kept: int) -> dict[str, Any]:
    n = len(log.stamps)
    text = f"all {n:,} predictions"
    if n_kept < n:
        text = f"{n_kept:,} of {n:,} predictions, with the extremes of every stretch"
    exact = "times, angles and natural frequencies are exact"
    rows = [*provenance_rows(log), ["This page holds", f"{text}; {exact}"]]
    texts = {"Parameters": log.parameters_text, "Mechanism": log.mechanism_text}
    files = [{"name": name, "text": text} for name, text in texts.items() if text]
    return {"title": "What made this log", "rows": rows, "files": files}


def _shades(log: Log, missing: list[tuple[float, float]], axis: TimeAxis) -> list[list[Any]]:
    times, real = axis.place(log.times).tolist(), real_times(log)
    shades: list[list[Any]] = []
    for start, end in missing:
        text = [_span(end - start)] if (start, end) in axis.shortened else []
        shades.append([*axis.place(np.array([start, end])).tolist(), "gap", *text])
    for k in log.passes.tolist():
        text = [f"clock back {_span(float(real[k - 1] - real[k]))}"]
        shades.append([times[k - 1], times[k], "jump", *text])
    for kind, statuses in (("range", _INVALID), ("toggle", (Status.NEAR_TOGGLE,))):
        for start, end in runs(np.isin(log.status, statuses)):
            shades.append([times[start], times[min(end, len(times) - 1)], kind])
    return shades


def _excitations(log: Log, rows: IntArray, axis: TimeAxis) -> Items:
    """Return each excitation over time; only while it was nearest if the log lacks its file."""

    def line(name: str, style: str, times: FloatArray, values: FloatArray) -> dict[str, Any]:
        places = {"times": axis.place(times), "values": values.astype(np.float32)}
        return {"name": name, "style": style, **places}

    lines = []
    speeds = dict(log.speeds)
    for source in Source:
        fixed = _number(log, f"{source.value}_speed", -1.0)
        if fixed > 0.0:
            speeds[source] = np.array([0.0, log.times[-1]]), np.array([fixed, fixed])
    for excitation in log.excitations:
        if excitation.source in speeds:
            times, values = speeds[excitation.source]
            style = _STYLES[excitation.source]
            lines.append(line(excitation.name, style, times, excitation.ratio * values))
    if log.excitations or log.resonances is None:
        return lines
    nearest, times = log.resonances.excitation[rows], log.times[rows]
    for name in filter(None, _excitation_names(log)):
        is_nearest = nearest == name
        near = is_nearest | np.append(
            False, is_nearest[:-1]
        )  # The sample after each run ends its line.
        values = np.where(is_nearest, log.resonances.excitation_frequency[rows], np.nan)
        lines.append(line(name, "solid", times[near], values[near]))
    return lines


def _number(log: Log, name: str, default: float) -> float:
    value = log.parameters.get(name, default)
    return float(value) if isinstance(value, int | float) else default
