# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The starter files of the four categories."""

import math

import numpy as np
import pytest
import yaml

from linkage_vibration.mechanics.mode_names import kinetic_energy, name_modes
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.prediction.doubts import excitation_doubts, linkage_doubts
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.studies.pose import pin_places
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.tabulation import build_table

MASTS, RANGES = (0.460, 0.610, 0.685, 0.685), (0.610, 0.650, 0.735, 0.760)  # of ISO 730, m


@pytest.mark.parametrize("category", [1, 2, 3, 4])
def test_a_starter_has_the_mast_and_the_range_of_its_category(category: int) -> None:
    """Nothing about it is doubtful, and its pins and the heights of E1 are as far apart."""
    path = config_file(f"starters/category_{category}.yaml")
    model = LinkageModel(read_mechanism(path))
    assert not [*linkage_doubts(model)]
    over = np.linspace(*model.mechanism.stroke, 181).tolist()
    places = [pin_places(model.mechanism, model.kinematics.at(alpha3)) for alpha3 in over]
    assert math.dist(places[0]["E1"], places[0]["E2"]) == pytest.approx(MASTS[category - 1])
    lift = np.ptp([pins["E1"][1] for pins in places])
    assert lift == pytest.approx(RANGES[category - 1], abs=5e-3)


@pytest.mark.nightly(short="test_a_starter_has_its_sideways_modes")
@pytest.mark.parametrize("category", [1, 2, 3, 4])
def test_a_starter_has_plausible_frequencies(category: int) -> None:
    """A table is built. The tractor has its modes in the plane at 1 to 4 Hz; the heave is above.

    The shipped excitations are plausible with it. At most one of 20 models with other numbers
    cannot be followed, so that factors of levels are known.

    The oil and the tractor's own modes bound the heave: a mass on a stiffer spring is faster.
    """
    path = config_file(f"starters/category_{category}.yaml")
    mechanism = read_mechanism(path)
    table = build_table(LinkageModel(mechanism), tolerance=1e-2)
    orders = [each for each in read_excitations(config_file("excitations.yaml")) if each.load]
    levels = LevelTable(Predictor(table), mechanism, orders)
    assert levels.has_load_ratios
    for half in table.halves:
        assert len(half.ensemble_poles) == 65
        assert np.isnan(half.ensemble_poles).any(axis=(1, 2)).mean() <= 0.05
    assert not [*excitation_doubts(orders, levels)]
    prediction = Predictor(table).predict(np.radians([90.0, 135.0, 179.0]))
    ways = "pitch", "bounce", "surge"
    tractor = [
        i for i, name in enumerate(table.mode_names) if name in {f"tractor {w}" for w in ways}
    ]
    heave = table.mode_names.index("implement heave")
    assert len(tractor) == 3
    assert (prediction.natural_frequencies[:, tractor] > 1.0).all()
    assert (prediction.natural_frequencies[:, tractor] < 4.0).all()
    assert (prediction.natural_frequencies[:, heave] > 5.0).all()
    assert (prediction.natural_frequencies[:, heave] < 15.0).all()
    deviations = prediction.frequency_stddevs[:, heave] / prediction.natural_frequencies[:, heave]
    assert (deviations > 0.1).all()
    assert (deviations < 0.2).all()


@pytest.mark.parametrize("category", [1, 2, 3, 4])
def test_a_starter_has_its_sideways_modes(category: int) -> None:
    """Tractor and implement have them from 0.7 to 8 Hz.

    The tractor sways slower than sqrt(k / m) of the tyres across, as it also rolls.
    """
    content = yaml.safe_load(config_file(f"starters/category_{category}.yaml").read_text())
    del content["uncertainty"]
    solution = LinkageModel(mechanism_from_mapping(content), half="lateral").solve(2.2)
    frequencies = solution.natural_frequencies[:5]
    names = dict(zip(name_modes(kinetic_energy(solution)), frequencies, strict=False))
    of = [f"{body} {way}" for body in ("tractor", "implement") for way in ("sway", "roll")]
    assert set(names) == {*of, "tractor yaw"}
    assert 0.7 < frequencies[0] < frequencies[-1] < 8.0
    k = sum(axle["stiffness"] for axle in content["lateral"]["axles"].values())
    mass = content["base"]["mass"] + content["rigid_bodies"]["implement"]["mass"]
    assert names["tractor sway"] < math.sqrt(k / mass) / (2.0 * math.pi)


def test_a_lever_of_32_mm_is_not_accepted_without_a_word() -> None:
    """With a third of the lever, a harrow of 2200 kg heaves slowly, and the doubt says why."""
    content = yaml.safe_load(config_file("starters/category_3.yaml").read_text())
    del content["uncertainty"]
    content["rigid_bodies"]["implement"]["mass"] = 2200.0
    heaves = []
    for share in (1.0, 0.3):
        cylinder = content["springs"]["lift_cylinders"]["cylinder"]
        cylinder |= {"rod_end": [0.036 * share, 0.120 * share], "bore": 0.08}
        cylinder |= {"closed_length": 0.3, "stroke": 0.4}
        model = LinkageModel(mechanism_from_mapping(content))
        heaves.append(model.solve(math.radians(135.0)).natural_frequencies[3])
        assert bool([*linkage_doubts(model)]) == (share < 1.0)
    assert "tractors reach 200 bar; check base_end, rod_end and bore." in " ".join(
        linkage_doubts(model)
    )
    assert heaves[1] < 0.5 * heaves[0]
