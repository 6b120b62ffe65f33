# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A page with the measured vibration of a drive beside the predicted one."""

import html
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from linkage_vibration.drawing import palette
from linkage_vibration.drawing.plots import frequency_axis, name_modes, png_bytes, tidy
from linkage_vibration.listening.amplitudes import (
    AGREES,
    MeasuredOrder,
    measure_orders,
    predicted_levels,
    unit_responses,
)
from linkage_vibration.listening.drive_modes import DriveMode, search_signals, why_no_modes
from linkage_vibration.listening.model_check import (
    WARNING,
    Explanation,
    difference_text,
    explanations,
    verdict,
)
from linkage_vibration.listening.orders import Orders, levels, spectrogram, track_orders
from linkage_vibration.listening.output_only import finish
from linkage_vibration.listening.sensor_response import SensorResponse
from linkage_vibration.listening.signals import Signal, known_at
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.prediction.verdict import KNOWN
from linkage_vibration.review.findings import all_speeds, log_limits
from linkage_vibration.review.html import COVERAGE, picture_tag, plain_html, table_tag
from linkage_vibration.review.log import Log, ReviewError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LABELLED = 5  # orders with a name in the picture
_CANNOT = (
    "A signal at one place shows neither the forces in the pins nor a mode that does not move it; "
    "the ground's part is not predicted at a sensor. One drive does not validate the model."
)


@dataclass(frozen=True, slots=True, eq=False)
class SensorComparison:
    """What a sensor heard: orders, levels in windows, and predicted levels with their factor."""

    signal: Signal
    orders: Orders
    rows: list[MeasuredOrder]
    measured: FloatArray  # (m,), rms, m/s or N
    predicted: FloatArray  # (m,), of all orders but those below; NaN where a speed is not known
    compared: float  # share of the predicted mean square that was compared, by order, 1
    unknown: tuple[str, ...]  # sources of orders whose speeds the log lacks
    reference: FloatArray  # (m,), N, what load ratios refer to; NaN if it is not known


def compare_sensor(log: Log, signal: Signal) -> SensorComparison:
    """Return what a sensor heard in the drive of a log, beside what its model predicts there."""
    if log.table is None or log.mechanism is None or not log.excitations:
        raise ReviewError(f"{log.path} holds no table with excitations; replay the drive again.")
    (first, last), end = signal.times[[0, -1]], float(log.times[-1])
    if first > end or last < 0.0:
        text = f"{signal.sensor.name} measured from {first:.6g} to {last:.6g} s since the first"
        text += f" prediction, and the drive ends at {end:.6g} s"
        raise ReviewError(f"{log.path}: {text}; correct the clocks of both, or `starts_at`.")
    transfer = SensorResponse(log.table, log.mechanism, log.excitations, signal.sensor)
    speeds = all_speeds(log)
    orders = track_orders(signal, log.excitations, speeds)
    angles = known_at(orders.times, log.times, log.table_angle)
    units = unit_responses(transfer, orders, angles)
    rows = measure_orders(log.excitations, orders, units, transfer)
    sources = dict.fromkeys(log.excitations[i].source for i in transfer.loaded)
    unknown = tuple(source.value for source in sources if source not in speeds)
    predicted, squares = predicted_levels(transfer, log.excitations, orders, units, speeds)
    names = [row.excitation.name for row in rows if row.is_compared]
    heard = np.isfinite(orders.squares) & [each.name in names for each in log.excitations]
    known = np.isfinite(predicted)
    every = float(squares[known].sum())
    share = float(known.mean() * squares[known][heard[known]].sum() / every) if every else 0.0
    measured = levels(signal)
    reference = np.full(len(angles), np.nan)
    if not signal.sensor.accelerates:
        place = log.table.force_places.index(signal.sensor.at.partition(".")[0])
        low, high = log.table.alpha3_range
        inside = (angles >= low) & (angles <= high)
        reference[inside] = log.table.reference_forces(angles[inside])[place]
    both = measured, predicted, 0.0 if unknown else share
    return SensorComparison(signal, orders, rows, *both, unknown, reference)


def heard_modes(log: Log, sensors: Sequence[SensorComparison]) -> tuple[DriveMode, ...]:
    """Return the modes that all accelerations on the linkage show together."""
    signals = [sensor.signal for sensor in sensors if sensor.signal.sensor.accelerates]
    if log.table is None or log.mechanism is None or not signals:
        return ()
    angle, speeds = (log.times, log.table_angle), all_speeds(log)
    given = log.table, log.mechanism, signals, angle, speeds, log.excitations
    return finish(search_signals(*given))


def modes_answer(log: Log, modes: Sequence[DriveMode], sensors: Sequence[SensorComparison]) -> str:
    """Return what the worst natural frequency of a drive says, or why none is reported."""
    if not modes and log.table is not None:
        signals = [sensor.signal for sensor in sensors if sensor.signal.sensor.accelerates]
        why = why_no_modes(log.table, signals, (log.times, log.table_angle))
        return f"No natural frequency was found. {why}"
    sure = [mode for mode in modes if not mode.doubt]
    worst = max(sure or modes, key=lambda mode: abs(np.nan_to_num(mode.difference)))
    text = difference_text(worst, log.mode_name(worst.mode) or f"mode {worst.mode + 1}")
    if not sure:
        return f"None of {len(modes)} natural frequencies is reported. {text}"
    agree, compared = (
        sum(mode.consistent in (True, each) for mode in sure) for each in (True, False)
    )
    more = f" {agree} of {compared} measured natural frequencies agree with the prediction."
    return text + (more if compared > 1 else "")


def answers(log: Log, sensors: Sequence[SensorComparison], modes: Sequence[DriveMode]) -> list[str]:
    """Return in words what was measured: contradictions first, then modes and each sensor."""
    off = [(each, row) for each in sensors for row in each.rows if row.contradicts]
    off.sort(key=lambda pair: -abs(math.log(pair[1].measured / pair[1].predicted)))
    first = " ".join(_contradiction(*pair) for pair in off)
    each = [f"{_orders_answer(sensor)}{_load_answer(sensor)}" for sensor in sensors]
    unknown = log.table is not None and np.isnan(log.damping_ratio_stddevs).any()
    why = log.table.unknown_deviations if log.table and unknown else ""
    return list(filter(None, [first, modes_answer(log, modes, sensors), *each, why]))


def is_calm(sensors: Sequence[SensorComparison], modes: Sequence[DriveMode]) -> bool:
    """Return whether modes and orders were compared, nearly all of them, and all agree."""
    sure = [mode for mode in modes if not mode.doubt]
    calm = bool(sure) and all(mode.consistent for mode in sure)
    calm &= not any(row.contradicts for sensor in sensors for row in sensor.rows)
    return calm and all(sensor.compared >= KNOWN for sensor in sensors)


def _contradiction(sensor: SensorComparison, row: MeasuredOrder) -> str:
    """Return how far an order at a sensor is from its prediction, and its probable cause."""
    factor = row.predicted / row.measured
    weaker, small = ("weaker", "large") if factor > 1.0 else ("stronger", "small")
    much = f"{'' if row.is_detected else 'at least '}{_short(max(factor, 1.0 / factor))} times"
    return (
        f"{row.excitation.name} at {sensor.signal.sensor.name} is {much} {weaker} than predicted, "
        f"which its deviations do not allow; probably its amplitude in the excitation file is "
        f"{much} too {small}."
    )


def _orders_answer(sensor: SensorComparison) -> str:
    """Return how many orders at a sensor agree with their predictions, and what is not known."""
    compared = [row for row in sensor.rows if row.is_compared]
    parts = [
        f"At {sensor.signal.sensor.name}, {sum(not row.contradicts for row in compared)} of "
        f"{_count(len(compared), 'order')} agree with the prediction (within {AGREES:g} standard "
        f"deviations)."
    ]
    if sensor.compared < KNOWN:
        share = math.floor(100.0 * sensor.compared)
        parts.append(
            f"They make {share} % of what is predicted; whether the rest agrees is not known."
        )
    others = [row for row in sensor.rows if row not in compared]
    if alone := sum(row.is_detected for row in others):
        parts.append(f"{_count(alone, 'more order')} above the noise cannot be predicted.")
    if below := len(others) - alone:
        parts.append(f"{_count(below, 'more order')} cannot be distinguished from the noise.")
    return " ".join(parts)


def _count(count: int, noun: str) -> str:
    """Return a number of things in words."""
    return f"{count} {noun}{'s' * (count != 1)}"


def _load_answer(sensor: SensorComparison) -> str:
    """Return the largest load ratios at a sensor, if they are measured."""
    largest = [
        float(np.fmax.reduce(each / sensor.reference, initial=-1.0))
        for each in (sensor.measured, sensor.predicted)
    ]
    if largest[0] < 0.0:
        return ""
    words = [f"up to {ratio:.2g}" if ratio >= 0.0 else "not known" for ratio in largest]
    return f" Its load ratio is {words[0]}; that of the predicted orders is {words[1]}."


def listening_page(
    log: Log, sensors: Sequence[SensorComparison], modes: Sequence[DriveMode]
) -> str:
    """Return the text of the page."""
    signals = [sensor.signal for sensor in sensors]
    doubts = [(s.sensor.name, text) for s in signals for text in s.doubts or ("none",)]
    parts = [_modes_table(log, modes)] if modes else []
    parts += [_orders_table(sensor) for sensor in sensors]
    parts.append(_table("What is doubtful about the sensors", ["sensor", "doubt"], doubts))
    title, more = "Measured beside predicted", "".join(parts)
    sentences = [*answers(log, sensors, modes), _CANNOT]
    sure = [mode for mode in modes if not mode.doubt]
    picture = picture_tag(_picture(log, sensors, sure), "Spectra and levels over time.")
    return plain_html(title, sentences, picture + more, calm=is_calm(sensors, modes))


def _modes_table(log: Log, modes: Sequence[DriveMode]) -> str:
    """Return modes beside their predictions, those that are reported first."""
    head = ["mode", "crank angle [deg]", "predicted [Hz]", "measured [Hz]", "consistent"]
    rows, apart = [], [mode for mode in modes if not mode.doubt and mode.consistent is False]
    assert log.table is not None
    assert log.mechanism is not None
    model = log.table, log.mechanism
    for mode in sorted(modes, key=lambda mode: bool(mode.doubt)):
        deviation = math.nan if mode.doubt else mode.deviation
        both = (mode.predicted, mode.predicted_stddev), (mode.frequency, deviation)
        row = [log.mode_label(mode.mode), f"{math.degrees(mode.alpha3):.1f}"]
        row += [f"{f:.2f} ± {f * deviation:.2f}".replace(" ± nan", "") for f, deviation in both]
        explained = explanations(*model, [mode]) if mode in apart else ()
        rows.append([*row, verdict(mode), *(_best(explained) for _ in apart[:1])])
    head += ["may be explained by a change of"] * bool(apart)
    explained = explanations(*model, modes) if apart else ()
    note = f"All together: {_best(explained)}. {WARNING}" if explained else ""
    return _table("Natural frequencies, with one standard deviation", head, rows, note)


def _best(explained: Sequence[Explanation]) -> str:
    """Return the number that explains most, in words; empty if there is none."""
    words = [f"{each.path}, by {each.change:+.1f} standard deviations" for each in explained[:1]]
    return "".join(words)


def _picture(log: Log, sensors: Sequence[SensorComparison], modes: Sequence[DriveMode]) -> bytes:
    """Return spectrograms and levels as a PNG picture."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 6.8 * len(sensors)), dpi=110, layout="constrained")
    axes = figure.subplots(
        2 * len(sensors), squeeze=False, sharex=True, height_ratios=[2.4, 1.0] * len(sensors)
    )[:, 0]
    for i, sensor in enumerate(sensors):
        _draw_spectrogram(axes[2 * i], log, sensor)
        for mode in modes:
            hertz, deviation = mode.frequency, COVERAGE * mode.frequency * mode.deviation
            colour = palette.mode_colours(log.n_modes)[mode.mode]
            style = {"fmt": "o", "ms": 5.0, "mec": palette.INK, "capsize": 4.0, "color": colour}
            style["ecolor"] = palette.INK
            axes[2 * i].errorbar(mode.times, [hertz] * len(mode.times), deviation, **style)
        _draw_levels(axes[2 * i + 1], sensor, log_limits(log).warning)
        axes[2 * i + 1].set_xlabel("time since the first prediction [s]")
        axes[2 * i + 1].tick_params(labelbottom=True)
    return png_bytes(figure)


def _draw_spectrogram(ax: "Axes", log: Log, sensor: SensorComparison) -> None:
    """Draw the measured spectrum over time under predicted modes and orders."""
    times, frequencies, power = spectrogram(sensor.signal)
    decibels = 10.0 * np.log10(np.maximum(power[:, 1:], 1e-12))
    low, high = np.percentile(decibels, [30.0, 99.8])
    style = {"shading": "nearest", "cmap": "Greys", "vmin": low, "vmax": high}
    image = ax.pcolormesh(times, frequencies[1:], decibels.T, rasterized=True, **style)
    unit = "(m/s²)²/Hz" if sensor.signal.sensor.accelerates else "N²/Hz"
    ax.figure.colorbar(image, ax=ax, pad=0.16, aspect=40, label=f"measured [dB of 1 {unit}]")
    top = 0.5 * sensor.signal.rate
    ends = np.full(log.n_modes, np.nan)
    for mode, colour in enumerate(palette.mode_colours(log.n_modes)):
        values = log.natural_frequencies[:, mode]
        deviation = COVERAGE * np.nan_to_num(log.frequency_stddevs[:, mode])
        ax.fill_between(log.times, values - deviation, values + deviation, color=colour, alpha=0.3)
        ax.plot(log.times, values, color=colour, lw=1.4)
        if (shown := values[np.isfinite(values) & (values < top)]).size:
            ends[mode] = shown[-1]
    frequency_axis(ax, ends)
    ax.set_ylim(max(0.5, float(frequencies[1])), top)
    rows = sorted((row for row in sensor.rows if row.is_detected), key=lambda row: -row.measured)
    names, orders = [each.name for each in log.excitations], list[tuple[str, float]]()
    for row in rows[:_LABELLED]:
        hertz = sensor.orders.frequencies[:, names.index(row.excitation.name)]
        hertz = np.where(hertz > 0.0, hertz, np.nan)
        ax.plot(sensor.orders.times, hertz, color=palette.INK, ls=":")
        if (turning := hertz[np.isfinite(hertz)]).size:
            orders.append((row.excitation.name, float(turning[-1])))
    name_modes(ax, ends, [log.mode_name(mode) for mode in range(log.n_modes)], orders, least=0.05)
    title = f"{sensor.signal.sensor.name}: measured spectrum (grey), predicted (bands) and measured"
    title += "\nnatural frequencies (points), with two standard deviations, and orders (dotted)"
    ax.set_title(title, loc="left", fontsize=12)


def _draw_levels(ax: "Axes", sensor: SensorComparison, limit: float) -> None:
    """Draw measured and predicted levels, or load ratios with the limit of a warning, over time."""
    name, scale = "rms [N]", np.array(1.0)
    if sensor.signal.sensor.accelerates:
        name, scale = "rms [mm/s]", np.array(1e3)
    elif np.isfinite(sensor.reference).any():
        name, scale = "load ratio [1]", 1.0 / sensor.reference
        ax.axhline(limit, color=palette.INK, ls="--", lw=1.0)
        ax.annotate("warning", (0.005, 1.08 * limit), xycoords=ax.get_yaxis_transform(), fontsize=9)
    measured, predicted = scale * sensor.measured, scale * sensor.predicted
    factor = max((row.predicted_factor for row in sensor.rows if row.predicted > 0.0), default=1.0)
    times = sensor.orders.times
    band = predicted / factor, predicted * factor
    ax.fill_between(times, *band, color=palette.COLOURS[1], alpha=0.25, step="mid")
    without = ", ".join(sensor.unknown)
    lacking = f" (without {without}, whose speed the log lacks)" if without else ""
    label = f"predicted, orders alone{lacking}, with one standard deviation"
    ax.step(times, predicted, where="mid", color=palette.COLOURS[1], label=label)
    label = "measured, everything from 1 Hz"
    ax.step(times, measured, where="mid", color=palette.INK, label=label)
    ax.set_ylabel(name)
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter("{x:g}")
    positive = np.concatenate([measured, *band])
    if (positive := positive[positive > 0.0]).size:
        ax.set_ylim(0.5 * float(positive.min()), 2.0 * float(positive.max()))
    ax.legend(frameon=False, fontsize=10, ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    tidy(ax)


def _orders_table(sensor: SensorComparison) -> str:
    unit = "m/s²" if sensor.signal.sensor.accelerates else "N"
    head = ["order", "windows", f"measured, rms [{unit}]", f"predicted, rms [{unit}]"]
    head += ["difference / standard deviation", "amplitude of the excitation"]
    rows = []
    for row in sensor.rows:
        detected = f"{_short(row.measured, 3)} ± {_short(row.measured_stddev)}"
        cells = [row.excitation.name, str(row.windows)]
        cells.append(detected if row.is_detected else f"below {_short(row.measured)} (noise)")
        factor = f"{_short(row.predicted, 3)} (× or ÷ {_short(row.predicted_factor)})"
        cells.append("not known" if math.isnan(row.predicted) else factor)
        bound = "" if row.is_detected else "at most "
        cells.append("" if math.isnan(row.difference) else f"{bound}{row.difference:+.1f}")
        text, load = "", row.excitation.load
        if load is not None and not math.isnan(row.amplitude):
            text = f"{_short(row.amplitude, 3)} ± {100.0 * row.relative_stddev:.0f} %, not "
            text += f"{load.amplitude:g} {load.kind.unit}"
        rows.append([*cells, text])
    return _table(f"Orders at {sensor.signal.sensor.name}", head, rows)


def _short(value: float, digits: int = 2) -> str:
    """Return the first digits of a number, without an exponent if it is large."""
    return f"{float(f'{value:.{digits}g}'):g}"


def _table(title: str, head: Sequence[str], rows: Iterable[Sequence[str]], note: str = "") -> str:
    text = f'<p class="note">{html.escape(note)}</p>' if note else ""
    table = table_tag(title, head, rows)
    return f"<section><h2>{html.escape(title)}</h2>{text}{table}</section>\n"
