# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the levels by the ground over height and speed: ``python -m benchmark ground_map``."""

import math
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from linkage_vibration.drawing.palette import GAP_SHADE, GREY, INK
from linkage_vibration.prediction.ground import GroundTable, Terrain
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table

NAME = "three_point_linkage_on_tractor"
PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "ground_map.png"
LUG_PITCH = 2.0 * math.pi * 0.8 / 20.0  # m: 20 lugs on a rolling radius of 0.8 m
CASES = {"class C": 256e-6, "class D": 1024e-6}  # m3 at 0.1 1/m
ANGLES, SPEEDS = np.linspace(90.0, 180.0, 181), np.linspace(2.0, 50.0, 193)  # deg, km/h
LEVELS = (0, 50, 100, 150, 200, 250, 300, 400, 500, 600, 700)  # mm/s
COLOURS = colormaps["viridis"](np.linspace(0.0, 1.0, len(LEVELS) - 1)).tolist()
LUGS, AIRBORNE = 4, 6  # reasons why a level is not known


def main() -> None:
    """Draw one map for each class."""
    mechanism = read_mechanism(config_file(f"{NAME}.yaml"))
    built = load_table(config_file(f"tables/{NAME}.npz"), mechanism)
    figure = Figure(figsize=(9.0, 3.9), dpi=110, layout="constrained")
    angles, speeds = np.meshgrid(ANGLES, SPEEDS)
    for axes, (label, roughness) in zip(
        figure.subplots(1, 2, sharey=True), CASES.items(), strict=True
    ):
        terrain = Terrain(roughness, lug_pitch=LUG_PITCH)
        values = GroundTable(built, mechanism, terrain).at(
            np.radians(angles.ravel()), speeds.ravel() / 3.6
        )
        level = 1e3 * values.velocity.reshape(angles.shape)
        why = values.reason.reshape(angles.shape)
        assert np.nanmax(level) < LEVELS[-1]  # or known levels would look unknown
        axes.set_facecolor(GAP_SHADE)
        shades = axes.contourf(ANGLES, SPEEDS, level, levels=LEVELS, colors=COLOURS)
        axes.contour(ANGLES, SPEEDS, level, levels=LEVELS, colors="white", linewidths=0.5)
        for reason, words in ((LUGS, "lugs too coarse"), (AIRBORNE, "tyres off the ground")):
            rows, columns = np.nonzero(why == reason)
            if len(rows):
                at = ANGLES[columns].mean(), SPEEDS[rows].mean()
                axes.annotate(
                    f"not known: {words}", at, ha="center", va="center", fontsize=8, color=INK
                )
        axes.set_title(label, fontsize=9)
        axes.set_xlabel("crank angle [deg]: hitch up at 90, down at 180", fontsize=8)
        axes.tick_params(colors=GREY, labelsize=8)
    figure.axes[0].set_ylabel("ground speed [km/h]", fontsize=8)
    figure.colorbar(shades, ax=figure.axes, label="E1 along z, mm/s rms")
    figure.savefig(PICTURE)


if __name__ == "__main__":
    main()
