# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A measured profile of the ground through replay, from its file to the log and the page."""

import math
from pathlib import Path

import numpy as np

from benchmark.force_integration import Run
from benchmark.working_hour import RATE, write_bag
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.review.html import page_parts
from linkage_vibration.review.log import read_log
from linkage_vibration.review.review_page import review_page
from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file

ALPHA3, SPEED = math.radians(135.0), 8.0
SPACING = 0.1  # m


def test_measured_profile_from_its_file_to_the_page(tmp_path: Path) -> None:
    """Levels of the log are within 5 % of what Fourier's sum over the mean of both tracks shakes.

    The tracks of 20 km are random walks, whose waves pass through the model without its table.
    """
    tracks = np.cumsum(np.random.default_rng(5).standard_normal((200_000, 2)), axis=0) * 1e-3
    rows = [f"{SPACING * i:.1f},{left:.6f},{right:.6f}" for i, (left, right) in enumerate(tracks)]
    heights = tracks.mean(axis=1)
    (tmp_path / "lane.csv").write_text("\n".join(rows) + "\n")
    file, bag, log = (tmp_path / name for name in ("mine.yaml", "bag.mcap", "log.mcap"))
    field = "field: {speed: ground, terrain: {profile: lane.csv}, raised: true}\n"
    rotor = "rotor: {speed: pto, orders: [1], force: [60.0], at: E1.z, at_speed: 540.0}\n"
    file.write_text(field + rotor)  # which does not turn
    times = np.arange(2 * RATE + 1) / RATE
    speeds = {source: np.zeros(len(times)) for source in Source}
    speeds[Source.GROUND] += SPEED
    write_bag(bag, Run(times, np.full(len(times), ALPHA3), speeds))
    replay(bag, log, Parameters(excitation_file=str(file)))
    actual = read_log(log)
    assert actual.drive is not None
    level = float(actual.drive.resonances.total_velocity[-1])

    # Both ends are brought to the same height, as the sum repeats the profile.
    waves = np.fft.rfft(heights - np.linspace(heights[0], heights[-1], len(heights)))
    f = SPEED * np.fft.rfftfreq(len(heights), SPACING)
    band = (f >= 0.3) & (f <= 20.0)
    s = 2j * math.pi * f[band]
    model = LinkageModel(read_mechanism(config_file(DEFAULT_MECHANISM)))
    axles = [("rear_axle", "z"), ("front_axle", "z")]
    frf = model.solve(ALPHA3).frf([("E1", "z")], axles).frf(f[band])[:, 0]
    rear, front = 700.0e3 + 4460.0 * s, 600.0e3 + 3820.0 * s  # of the file
    moved = frf[:, 0] * rear * np.exp(-s * 2.5 / SPEED) + frf[:, 1] * front
    velocity = s * moved * waves[band] / len(heights)
    expected = math.sqrt(2.0 * float((np.abs(velocity) ** 2).sum()))
    assert abs(level / expected - 1.0) < 0.05
    page = review_page(actual)
    assert b"lane.csv" in b"".join(page_parts(page))
    [load] = [chart for chart in page.content["charts"] if chart["id"] == "load"]
    lines = {line["label"]: line["colour"] for line in load["series"]}
    assert [*lines][:3] == ["ground", "orders together, at most", "all sources"]
    assert len(set(lines.values())) == 3
