# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Sums up logs, one line for each drive, as a page or as values for a dashboard."""

import html
import math
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from linkage_vibration.errors import LinkageVibrationError, check_type
from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.verdict import (
    KNOWN,
    Durations,
    contributions,
    durations,
    episodes,
    worst_message,
)
from linkage_vibration.review.findings import first_sentence, is_calm
from linkage_vibration.review.html import plain_html, table_tag
from linkage_vibration.review.log import Log, ReviewError, gaps, read_log
from linkage_vibration.support.progress import Map, gathered

_BAG_FILE = "metadata.yaml"  # a folder with this file is one bag


def logs_of(paths: Sequence[Path]) -> list[Path]:
    """Return logs among files and folders; a folder that is no bag stands for its MCAP files."""
    logs: list[Path] = []
    for path in paths:
        several = path.is_dir() and not (path / _BAG_FILE).exists()
        inside = sorted(path.glob("*.mcap")) if several else [path]
        if not inside:
            raise ReviewError(f"{path} holds no .mcap file; give logs, or a folder of logs.")
        logs += inside
    return logs


def drive_summary(log: Log) -> dict[str, Any]:
    """Return a drive as JSON holds it, as docs/review.md describes; what is not known is None."""
    drive = log.drive
    warnings = [] if drive is None else episodes(drive)
    parts = [] if drive is None else contributions(drive)
    limits, judged, worst = list[float | None](), False, None
    spent = Durations(0.0, 0.0, float(log.times[-1]))
    if drive is not None:
        limits = [_rounded(limit) for limit in np.unique(drive.resonances.load_ratio_limit)]
        spent = durations(drive)
        judged = bool(np.isfinite(drive.resonances.total_load_ratio).any()) or spent.above > 0.0
    if drive is not None and drive.may_be_worst.any():
        row = worst_message(drive)
        at = drive.resonances.message(row)
        worst = {
            "time_s": _rounded(drive.times[row]),
            "crank_angle_deg": _rounded(math.degrees(drive.angles[row])),
            "load_ratio": _rounded(at.total_load_ratio),
            "load_ratio_factor": _rounded(at.total_load_ratio_factor),
            "unknown_factor": at.unknown_factors if np.isnan(at.total_load_ratio_factor) else "",
            "place": at.total_load_place,
            "excitation": at.excitation,
            "excitation_frequency_hz": _rounded(at.excitation_frequency),
            "mode": None if math.isnan(at.natural_frequency) else int(at.mode) + 1,
            "mode_name": None if math.isnan(at.natural_frequency) else log.mode_name(int(at.mode)),
        }
    start = datetime.fromtimestamp(int(log.stamps[0]) / 1e9, timezone.utc)
    return {
        "log": str(log.path),
        "start": start.isoformat(timespec="milliseconds"),
        "duration_s": _rounded(log.times[-1]),
        "predictions": len(log.stamps),
        "not_ok": int((log.status != Status.OK).sum()),
        "gaps": len(gaps(log)),
        "clock_jumps": len(log.passes),
        "input_faults": list(log.input_faults),
        "calm": is_calm(log),
        "mode_names": list(log.table.mode_names) if log.table else [],
        "warnings": len(warnings) if judged else None,
        "in_warning_s": _rounded(sum(e.duration for e in warnings)) if judged else None,
        "load_ratio_limits": limits,
        "above_limit_s": _rounded(spent.above) if judged else None,
        "below_limit_s": _rounded(spent.below) if judged else None,
        "unknown_s": _rounded(spent.unknown),
        "known_share": _rounded(spent.known_share),
        "excitations": [
            {
                "name": part.name,
                "load_ratio": _rounded(part.load_ratio),
                "in_warning_s": _rounded(part.warning_time) if part.known else None,
                "in_note_s": _rounded(part.note_time) if part.known else None,
            }
            for part in parts
        ],
        "worst": worst,
        "sentence": first_sentence(log),
        "model": {
            "table_id": log.table_id,
            "mechanism": log.table.mechanism_name if log.table else None,
            "model_hash": log.table.model_hash if log.table else None,
            "unknown_deviations": log.table.unknown_deviations if log.table else None,
        },
    }


def summaries(logs: Sequence[str | Path], *, map: Map = map) -> list[dict[str, Any]]:
    """Sum up what happened in many drives.

    Parameters
    ----------
    logs : sequence of str or Path
        MCAP files, and folders of bags or of MCAP files.
    map : callable
        Python's own `map`, that of a process pool, or that of a Dask client.

    Returns
    -------
    list of dict
        What ``linkage-vibration review --json`` prints of each drive; what is not known is None. A
        log that cannot be read has the keys ``log`` and ``error`` alone.

    Raises
    ------
    LinkageVibrationError
        If a folder holds no MCAP file.
    """
    check_type(logs, "give a list of paths", list, tuple)
    paths = logs_of([Path(log) for log in logs])
    return gathered(map(_summary, paths), len(paths))


def _summary(path: Path) -> dict[str, Any]:
    """Return the values of a drive, or why its log cannot be read."""
    try:
        return drive_summary(read_log(path))
    except LinkageVibrationError as error:
        return {"log": str(path), "error": str(error)}


def overview_html(drives: Sequence[tuple[dict[str, Any], str]], failures: Sequence[str]) -> str:
    """Return a page with a row for each drive and a link to its page, and with each failure."""
    head = ["drive", "what happened", "warnings", "in warning [s]", "largest load ratio"]
    head += ["start, UTC", "duration [s]", "model"]
    files = [Path(drive["log"]) for drive, _ in drives]
    alike = len({file.name for file in files}) < len(files)
    names = [str(file) if alike else file.name for file in files]
    rows = [_cells(drive, name) for (drive, _), name in zip(drives, names, strict=True)]
    notes = "".join(f'<p class="failure">{html.escape(text)}</p>\n' for text in failures)
    calm = [drive["calm"] for drive, _ in drives]
    table = table_tag("Drives", head, rows, [quote(page) for _, page in drives], calm)
    hint = "Each row is a drive. Choose its name to see its page. Green: no warning, and no load "
    hint += f"above the limit, known for at least {100.0 * KNOWN:.0f} % of the drive, and no doubt "
    hint += "about the inputs."
    return plain_html("Drives", [hint], notes + table)


def _cells(drive: dict[str, Any], name: str) -> list[str]:
    worst, unknown, keys = drive["worst"], "not known", ("warnings", "in_warning_s")
    shown = [unknown if drive[key] is None else str(drive[key]) for key in keys]
    shown += [unknown if worst is None else f"{worst['load_ratio']:.2g}"]
    shown += [drive["start"][:19].replace("T", " ")]
    model = drive["model"]["mechanism"] or "not in the log"
    more = f"{drive['duration_s']:.1f}", f"{model}, table {drive['model']['table_id']}"
    return [name, drive["sentence"], *shown, *more]


def _rounded(value: float) -> float | None:
    """Return a number with six digits for JSON; None if it is not known."""
    return float(f"{value:.6g}") if np.isfinite(value) else None
