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

from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.resonance import ResonanceState
from linkage_vibration.review.findings import first_sentence, meetings, real_times
from linkage_vibration.review.html import page_file
from linkage_vibration.review.log import Log, ReviewError, durations, gaps
from linkage_vibration.review.moments import moments

_NO_BAG = "metadata.yaml"  # a folder with this file is one bag


def logs_of(paths: Sequence[Path]) -> list[Path]:
    """Return the logs among files and folders; a folder that is no bag stands for its MCAP files.

    Raises
    ------
    ReviewError
        If a folder holds no MCAP file.
    """
    logs: list[Path] = []
    for path in paths:
        if not path.is_dir() or (path / _NO_BAG).exists():
            logs.append(path)
            continue
        inside = sorted(path.glob("*.mcap"))
        if not inside:
            raise ReviewError(f"{path} holds no .mcap file; give logs, or a folder of logs.")
        logs += inside
    return logs


def drive_summary(log: Log) -> dict[str, Any]:
    """Return a drive as values that JSON holds; what is not known is None.

    Returns
    -------
    dict
        ``log``; ``start``, UTC; ``duration_s``; ``predictions``; ``not_ok``, predictions without
        the status OK; ``gaps``; ``clock_jumps``; ``mode_names``, empty if they are not known;
        ``in_resonance_s``, the time of warnings about each mode, or None; ``worst``, its time,
        angle, excitation, mode, duration and amplification, or None; ``sentence``; ``model``, the
        ids of table and model.
    """
    met = meetings(log, moments(log))
    near = None
    if log.resonances is not None and (log.resonances.state != ResonanceState.STALE).any():
        warning, held = log.resonances.state == ResonanceState.WARNING, durations(log)
        modes = range(log.n_modes)
        near = [float(held[warning & (log.resonances.mode == mode)].sum()) for mode in modes]
    worst = None
    if met:
        first = met[0]
        worst = {
            "time_s": float(real_times(log)[first.strongest]),
            "crank_angle_deg": math.degrees(log.crank_angle[first.strongest]),
            "excitation": first.excitation,
            "mode": first.mode + 1,
            "mode_name": log.mode_name(first.mode),
            "duration_s": first.worst.end - first.worst.start,
            "amplification": first.amplification,
            "amplification_stddev": _known(first.amplification_stddev),
            "avoid": first.avoid,
        }
    start = datetime.fromtimestamp(int(log.stamps[0]) / 1e9, timezone.utc)
    return {
        "log": str(log.path),
        "start": start.isoformat(timespec="milliseconds"),
        "duration_s": float(log.times[-1]),
        "predictions": len(log.stamps),
        "not_ok": int((log.status != Status.OK).sum()),
        "gaps": len(gaps(log)),
        "clock_jumps": len(log.passes),
        "mode_names": list(log.table.mode_names) if log.table else [],
        "in_resonance_s": near,
        "worst": worst,
        "sentence": first_sentence(log, met),
        "model": {
            "table_id": log.table_id,
            "mechanism": log.table.mechanism_name if log.table else None,
            "model_hash": log.table.model_hash if log.table else None,
        },
    }


def overview_html(drives: Sequence[tuple[dict[str, Any], str]], failures: Sequence[str]) -> str:
    """Return a page with one row for each drive, and a sentence for each log that failed.

    Each drive is a dict of `drive_summary` with the relative address of its page.
    """
    n_modes = max((len(drive["in_resonance_s"] or ()) for drive, _ in drives), default=0)
    names = [list(drive["mode_names"]) for drive, _ in drives if drive["mode_names"]]
    shared = names[0] if names and all(others == names[0] for others in names) else []
    shared += [""] * (n_modes - len(shared))
    modes = [f"near {name or f'mode {i}'} [s]" for i, name in enumerate(shared[:n_modes], 1)]
    head = ["drive", "worst moment", *modes, "start, UTC", "duration [s]", "model"]
    files = [Path(drive["log"]) for drive, _ in drives]
    alike = len({file.name for file in files}) < len(files)
    texts = [str(file) if alike else file.name for file in files]
    rows = "".join(
        f"<tr>{_cells(drive, page, text, n_modes)}</tr>\n"
        for (drive, page), text in zip(drives, texts, strict=True)
    )
    columns = "".join(f'<th scope="col">{html.escape(text)}</th>' for text in head)
    notes = "".join(f'<p class="failure">{html.escape(text)}</p>\n' for text in failures)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<link rel="icon" href="data:,">\n<title>Drives</title>\n<style>{page_file("page.css")}'
        "main.drives { display: block; } .drives td { border-top: 1px solid var(--line); }\n"
        ".drives .scroll { max-height: none; } .drives td:nth-child(2) { min-width: 16em; }\n"
        "</style>\n</head>\n<body>\n<header>\n<h1>Drives</h1>\n"
        "<p>Each row is a drive. Choose its name to see its page.</p>\n</header>\n"
        f'<main class="drives">\n{notes}<div class="scroll" tabindex="0" aria-label="Drives">'
        f"<table><thead><tr>{columns}</tr></thead><tbody>\n{rows}</tbody></table></div>\n"
        "</main>\n</body>\n</html>\n"
    )


def _cells(drive: dict[str, Any], page: str, name: str, n_modes: int) -> str:
    near = drive["in_resonance_s"]
    shown = ["not known"] * n_modes if near is None else [f"{value:.2f}" for value in near]
    shown += [""] * (n_modes - len(shown))
    model = drive["model"]["mechanism"] or "not in the log"
    texts = [drive["sentence"], *shown, drive["start"][:19].replace("T", " ")]
    texts += [f"{drive['duration_s']:.1f}", f"{model}, table {drive['model']['table_id']}"]
    link = f'<a href="{html.escape(quote(page))}">{html.escape(name)}</a>'
    return f"<td>{link}</td>" + "".join(f"<td>{html.escape(text)}</td>" for text in texts)


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
