# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A calibration recovers parameters, reports what stays open, and keeps the layout of files."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from benchmark.calibrations import scores
from linkage_vibration.mechanics.description import Mechanism, MechanismError, coarser
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.paths import number_at, with_numbers
from linkage_vibration.readers.mechanism import load_yaml, read_mechanism
from linkage_vibration.readers.targets import HALVES, ModelMode, targets_text
from linkage_vibration.studies import calibration as study
from linkage_vibration.studies.calibrated_uncertainty import posterior_section, prior_section
from linkage_vibration.studies.calibration import (
    CalibrationError,
    CalibrationResult,
    CalibrationTask,
    Parameter,
    Target,
    _extreme,
    _natural_frequencies,
    _scatter,
    _undetermined,
    calibrate,
    fit_report,
    read_calibration,
    write_mechanism,
)
from linkage_vibration.support.resources import config_file

HEIGHT = "links.lower_link.section.height"
DIAMETER = "links.lift_rod.section.diameter"
MASS = "rigid_bodies.implement.mass"
MODULUS = "links.input_crank.material.youngs_modulus"


def calibration(mapping: Any, targets: list[Target], *parameters: Parameter) -> CalibrationTask:
    """Return a calibration of the paper's linkage."""
    text = config_file("three_point_linkage.yaml").read_text()
    return CalibrationTask(mapping, text, parameters, tuple(targets))


def measured(mechanism: Mechanism) -> list[Target]:
    """Return the frequencies that a measurement of the linkage would give, meshed as in a fit."""
    asked = [Target(mode, math.radians(a), 1.0, 0.01) for mode in (1, 2, 3) for a in (90, 130, 175)]
    asked += [Target(3, "lowest", 1.0, 0.01), Target(2, "highest", 1.0, 0.01)]
    frequencies = _natural_frequencies(LinkageModel(coarser(mechanism, 10, 4)), asked)
    return [
        Target(target.mode, target.at, float(hz), target.deviation)
        for target, hz in zip(asked, frequencies, strict=True)
    ]


def test_known_parameters_are_recovered(mapping: Any, mechanism: Mechanism) -> None:
    """Wrong sections are corrected by the natural frequencies of the right ones."""
    mapping["links"]["lower_link"]["section"]["height"] = 0.045
    mapping["links"]["lift_rod"]["section"]["diameter"] = 0.022
    wrong = calibration(
        mapping, measured(mechanism), Parameter(HEIGHT, 0.02, 0.1), Parameter(DIAMETER, 0.02, 0.06)
    )
    result = calibrate(wrong, starts=1)
    assert result.values == pytest.approx([0.032, 0.029], rel=1e-4)
    assert result.undetermined == ()
    assert result.on_bound == ()
    assert (np.sqrt(np.diag(result.covariance)) < 0.1).all()
    text = fit_report(wrong, result)
    assert "mode 3 lowest" in text
    assert f"{HEIGHT:44}{0.032:12.4g}" in text


@pytest.mark.parametrize(("off", "sentence"), [(2.9, ""), (-3.1, "mode 1 at 140 deg is 3.1 of")])
def test_a_target_that_the_fit_leaves_is_named(
    mapping: Any, mechanism: Mechanism, off: float, sentence: str
) -> None:
    """A fit is not good if a target is more than three of its deviations off."""
    fit = calibration(mapping, measured(mechanism), Parameter(HEIGHT, 0.02, 0.1))
    result = calibrate(fit, starts=1)
    target = Target(1, math.radians(140.0), 4.0, 0.01)
    frequencies = np.array([4.0 * math.exp(0.01 * off)])
    text = fit_report(replace(fit, targets=(target,)), replace(result, frequencies=frequencies))
    assert f"The fit is not good: {sentence}" in text if sentence else "not good" not in text


def test_parameters_with_the_same_effect_are_reported(mapping: Any) -> None:
    """The width and the modulus of a massless crank both scale its stiffness alone."""
    crank = mapping["links"]["input_crank"]
    crank["material"] = dict(crank["material"], density=1e-3)
    targets = [each for each in measured(mechanism_from_mapping(mapping)) if each.mode == 1]
    width = "links.input_crank.section.width"
    both = calibration(
        mapping, targets, Parameter(width, 0.001, 1.0), Parameter(MODULUS, 1e10, 1e12)
    )
    result = calibrate(both, starts=1)
    assert result.undetermined == ((width, MODULUS),)
    assert "do not separate: " + width in fit_report(both, result)


def test_bounds_hold_and_are_reported(mapping: Any, mechanism: Mechanism) -> None:
    """A parameter whose best value is outside its bounds ends on one, and is named."""
    bounded = calibration(mapping, measured(mechanism), Parameter(HEIGHT, 0.04, 0.1))
    result = calibrate(bounded, starts=2)
    assert result.values == pytest.approx([0.04], rel=1e-6)
    assert result.on_bound == (HEIGHT,)
    assert "on a bound" in fit_report(bounded, result)


def test_paper_gives_the_default_sections(mechanism: Mechanism) -> None:
    """The shipped calibration gives the shipped sections, except for their rounding.

    Straight uniform links come within 10.1 % of all nine printed frequencies.
    """
    paper = read_calibration(config_file("calibrations/paper.yaml"))
    result = calibrate(paper, starts=1)
    default = [yaml_number(paper.mapping, parameter.path) for parameter in paper.parameters]
    assert result.values == pytest.approx(default, rel=0.08)
    wanted = np.array([target.frequency for target in paper.targets])
    assert np.abs(result.frequencies / wanted - 1.0).max() < 0.101
    own = _natural_frequencies(LinkageModel(mechanism), paper.targets)
    assert np.abs(own / wanted - 1.0).max() < 0.102


def yaml_number(mapping: Any, path: str) -> float:
    """Return a number of a nested mapping."""
    for key in path.split("."):
        mapping = mapping[key]
    return float(mapping)


def fitted(fit: CalibrationTask, values: list[float], **more: Any) -> CalibrationResult:
    """Return a result with these values of the parameters, known to 1 %, without priors."""
    n = len(values)
    none, nan = np.array([]), np.full(n, math.nan)
    known = np.ones(n, dtype=bool), 1e-4 * np.eye(n), nan, nan
    return replace(
        CalibrationResult(fit.names, np.array(values), *known, none, 1.0, (), ()), **more
    )


def sections(path: Path) -> tuple[list[str], Any]:
    """Return the lines of a file before its section of uncertain numbers, and that section."""
    text = path.read_text()
    before = text.partition("\n\n# `linkage-vibration calibrate`")[0]
    return before.splitlines(), yaml.safe_load(text)["uncertainty"]


def test_written_mechanism_keeps_its_comments(mapping: Any, tmp_path: Path) -> None:
    """Only the numbers change, and the file is read back with them."""
    fit = calibration(
        mapping,
        [],
        Parameter(HEIGHT, 0.02, 0.1),
        Parameter(MASS, 1.0, 1e4),
        Parameter("links.lower_link.material.youngs_modulus", 1e9, 1e12),
    )
    path = tmp_path / "mine.yaml"
    write_mechanism(fit, fitted(fit, [0.0351234, 912.5, 2.05e11]), path)
    before, (after, section) = fit.text.splitlines(), sections(path)
    assert len(before) == len(after)
    assert section["relative"] == dict.fromkeys([p.path for p in fit.parameters], 0.01)
    assert sum(a != b for a, b in zip(before, after, strict=True)) == 3
    changed = with_numbers(mapping, zip(fit.names, [0.0351234, 912.5, 2.05e11], strict=True))
    # An alias makes the links share one material, in the file and in the data read from it.
    changed["uncertainty"] = section
    assert read_mechanism(path).model_hash == mechanism_from_mapping(changed).model_hash
    with pytest.raises(CalibrationError, match="cannot be written"):
        write_mechanism(fit, fitted(fit, [0.03, 900.0, 2e11]), tmp_path / "none" / "mine.yaml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mechanism: none.yaml\nparameters: {}\ntargets: []", "none.yaml: cannot be opened"),
        ("mechanism: m.yaml\nparameters: {links.nothing: [1, 2]}\ntargets: []", "no key 'nothing'"),
        ("mechanism: m.yaml\nparameters: {name: [1, 2]}\ntargets: []", "not a number"),
        (f"mechanism: m.yaml\nparameters: {{{MASS}: [2, 1]}}\ntargets: []", "ascend"),
        (f"mechanism: m.yaml\nparameters: {{{MASS}: [1, 2]}}\ntargets: []", "targets"),
        (f"mechanism: m.yaml\nparameters: {{{MASS}: [1, 2]}}\ntargets: [{{mode: 1}}]", "missing"),
        ("mechanism: m.yaml\nparameters: {}\ntargets: [{mode: 1, at_deg: 90, hz: 3}]", "is empty"),
        ("[]", "mapping"),
    ],
)
def test_invalid_calibrations_are_refused(tmp_path: Path, text: str, words: str) -> None:
    """Each error names the file, the key and the fix."""
    (tmp_path / "m.yaml").write_text(config_file("three_point_linkage.yaml").read_text())
    path = tmp_path / "fit.yaml"
    path.write_text(text)
    with pytest.raises(CalibrationError, match=words) as raised:
        read_calibration(path)
    assert "fit.yaml" in str(raised.value)


def test_links_from_files_are_refused(mapping: Any) -> None:
    """A fit does not read the body of a link from a file, and says so."""
    rod = mapping["links"]["lift_rod"]
    mapping["links"]["lift_rod"] = {"points": rod["points"], "file": {"kind": "matrices"}}
    fit = calibration(mapping, [Target(1, 2.0, 1.0, 0.01)], Parameter(HEIGHT, 0.02, 0.1))
    with pytest.raises(MechanismError, match=r"in a file, which neither a fit nor a .* beam"):
        calibrate(fit, starts=1)


def test_linkage_that_never_closes_is_refused(mapping: Any) -> None:
    """If no starting point can be solved, the error gives the last problem."""
    mapping = yaml.safe_load(yaml.safe_dump(mapping, sort_keys=False))
    mapping["links"]["lift_rod"]["points"]["V1"] = 0.1
    target = Target(1, math.radians(100.0), 3.0, 0.01)
    with pytest.raises(CalibrationError, match="No start could be solved"):
        calibrate(calibration(mapping, [target], Parameter(HEIGHT, 0.02, 0.1)), starts=2)


def test_numbers_with_anchors_and_aliases(mapping: Any, tmp_path: Path) -> None:
    """A number keeps its anchor, and two parameters that are one number are refused."""
    text = config_file("three_point_linkage.yaml").read_text()
    text = text.replace("width: 0.050, height: 0.032", "width: &w 0.050, height: 0.032")
    text = text.replace("width: 0.020, height: 0.036", "width: *w, height: 0.036")
    width = "links.lower_link.section.width"
    first = CalibrationTask(yaml.safe_load(text), text, (Parameter(width, 0.01, 0.1),), ())
    write_mechanism(first, fitted(first, [0.043]), tmp_path / "mine.yaml")
    assert "width: &w 0.043, height" in (tmp_path / "mine.yaml").read_text()
    assert read_mechanism(tmp_path / "mine.yaml").name == "three_point_linkage"
    crank = Parameter("links.input_crank.section.width", 0.01, 0.1)
    two = CalibrationTask(first.mapping, text, (*first.parameters, crank), ())
    with pytest.raises(CalibrationError, match="one number"):
        write_mechanism(two, fitted(two, [0.043, 0.044]), tmp_path / "other.yaml")


def test_mode_that_the_model_does_not_have(mapping: Any) -> None:
    """A target beyond the modes of the model is refused."""
    far = calibration(mapping, [Target(900, 2.0, 3.0, 0.01)], Parameter(HEIGHT, 0.02, 0.1))
    with pytest.raises(CalibrationError, match="mode 900"):
        calibrate(far, starts=1)


COUPLER, ROCKER, CRANK = (f"links.{link}.section.height" for link in ("coupler", "rocker", "crank"))
NOISE = 0.01  # of measured natural frequencies
STATED = {COUPLER: 0.1, CRANK: 0.03}  # of the logarithms; the crank's height is no parameter


def four_bar(stated: dict[str, float] = STATED) -> CalibrationTask:
    """Return the calibration of two heights of a coarse four-bar with uncertain numbers."""
    text = config_file("four_bar.yaml").read_text().replace("[0.0, 360.0]", "[40.0, 80.0]")
    text = text.replace("material:", "elements: 3\n    modes: 2\n    material:")
    text += f"uncertainty: {{relative: {stated}}}\n"
    targets = [Target(m, math.radians(a), 1.0, NOISE) for m in (1, 2) for a in (45.0, 60.0, 75.0)]
    parameters = Parameter(COUPLER, 0.01, 0.04), Parameter(ROCKER, 0.015, 0.04)
    return CalibrationTask(yaml.safe_load(text), text, parameters, tuple(targets))


def measured_four_bar(factor: float = 1.0, **options: Any) -> CalibrationTask:
    """Return a calibration whose targets are exact for a coupler that is higher by a factor."""
    fit = four_bar(**options)
    exact = {key: value for key, value in fit.mapping.items() if key != "uncertainty"}
    own = with_numbers(exact, [(COUPLER, factor * number_at(exact, COUPLER))])
    frequencies = _natural_frequencies(LinkageModel(mechanism_from_mapping(own)), fit.targets)
    pairs = zip(fit.targets, frequencies.tolist(), strict=True)
    return replace(fit, targets=tuple(replace(t, frequency=hz) for t, hz in pairs))


@pytest.mark.parametrize(
    ("costs", "chosen"),
    [
        ((1e-20, 0.0), 0),
        ((1.0, 1.0 - 1e-14), 0),
        ((1.0, 1.0 - 0.9e-6), 0),
        ((1.0, 1.0 - 1.1e-6), 1),
        ((0.9e-9, 0.0), 0),
        ((1.1e-9, 0.0), 1),
    ],
)
def test_the_first_of_equally_good_fits(
    monkeypatch: pytest.MonkeyPatch, costs: tuple[float, float], chosen: int
) -> None:
    """The fit from the file's values stays unless a cost is lower by 1e-6 of it and 1e-9."""
    ends = [np.append(np.log(ends), 0.0) for ends in ([0.02, 0.025], [0.03, 0.04])]
    jac = np.eye(7, 3)
    fits = iter([SimpleNamespace(cost=c, x=x, jac=jac) for c, x in zip(costs, ends, strict=True)])
    monkeypatch.setattr(study, "least_squares", lambda *_, **__: next(fits))
    actual = calibrate(four_bar(), starts=2)
    assert actual.values[:2] == pytest.approx(np.exp(ends[chosen][:2]))


@pytest.mark.nightly(short="test_exact_targets_leave_less_uncertain")
def test_intervals_hold() -> None:
    """Of random linkages, 95 % of the intervals contain the true numbers and frequencies.

    The numbers are drawn from their priors: a parameter with a stated deviation, one without, and
    an uncertain number that is no parameter. The written file predicts the natural frequencies of
    the own linkage as well as it says. It needs the correlations, as errors of numbers cancel.
    """
    count = 150
    actual = scores(four_bar(), range(count), math.radians(50.0), 2)
    assert actual.names == (COUPLER, ROCKER, CRANK, "predicted mode 1", "predicted mode 2")
    stated = np.isfinite(actual.stated)
    assert (actual.deviations <= actual.stated)[:, stated].all()
    scatter, room = actual.errors.std(axis=0), 4.0 / math.sqrt(2.0 * count)
    assert (np.abs(scatter - 1.0) < room).all()
    assert (np.abs(actual.coverage - 0.95) < 0.5 * room).all()


def test_the_page_has_the_coverage_of_the_benchmark() -> None:
    """The page of statistics and the results of the benchmark print the same range."""
    root = Path(__file__).parents[2]
    pages = (root / "docs/statistics.md", root / "benchmark/results/calibrations.md")
    actual = [
        re.findall(r"Coverage is between ([\d.]+) and ([\d.]+) %", p.read_text()) for p in pages
    ]
    assert actual[0] == actual[1]
    assert len(actual[0]) == 1


def test_exact_targets_leave_less_uncertain() -> None:
    """No number is less certain than stated, and a number that targets show is more certain."""
    fit = measured_four_bar()
    result = calibrate(fit, starts=1)
    assert result.names == (COUPLER, ROCKER, CRANK)
    assert result.stated == pytest.approx([0.1, math.nan, 0.03], nan_ok=True)
    stddev = np.sqrt(np.diag(result.covariance))
    assert stddev[0] < 0.5 * 0.1
    assert stddev[2] < 0.03
    assert result.values == pytest.approx([0.02, 0.025, 0.03], rel=1e-5)
    text = fit_report(fit, result)
    assert f"{COUPLER:44}        0.02    10.0%           +0.0" in text
    assert f"{CRANK:44}        0.03     3.0%" in text
    assert f"{ROCKER:44}       0.025     none" in text
    assert "states no deviation of some parameters" in text
    assert "states no deviation" not in fit_report(fit, replace(result, stated=np.full(3, 0.1)))


def test_prior_and_targets_are_weighed() -> None:
    """One number, known before with s and by targets with t, moves by s^2 / (s^2 + t^2) of a gap.

    Then its variance is s^2 t^2 / (s^2 + t^2). The deviation t follows from a fit with s = 1.
    """
    gap, stated = 0.02, 0.01
    loose = measured_four_bar(math.exp(gap), stated={COUPLER: 1.0})
    loose = replace(loose, parameters=loose.parameters[:1])
    by_targets = 1.0 / (1.0 / float(calibrate(loose, starts=1).covariance[0, 0]) - 1.0)
    tight = replace(
        loose, mapping={**loose.mapping, "uncertainty": {"relative": {COUPLER: stated}}}
    )
    result = calibrate(tight, starts=1)
    share = stated**2 / (stated**2 + by_targets)
    assert 0.2 < share < 0.98
    assert math.log(result.values[0] / 0.02) == pytest.approx(share * gap, rel=0.02)
    assert result.moved[0] == pytest.approx(share * gap / stated, rel=0.02)
    assert result.covariance[0, 0] == pytest.approx(share * by_targets, rel=0.02)


def test_claims_of_parameters(tmp_path: Path) -> None:
    """A parameter takes the claim on its number, also by an alias; all are written again."""
    text = config_file("three_point_linkage_on_tractor.yaml").read_text()
    text = text.replace("uncertainty:", "uncertainty:  # old") + "# the end\n"
    names = (
        "links.upper_link.material.youngs_modulus",
        "rigid_bodies.implement.centre_of_gravity.E1",
        "base.mounts.rear_axle.stiffness.0",
    )
    fit = CalibrationTask(
        yaml.safe_load(text), text, tuple(Parameter(n, 0.1, 1e12) for n in names), ()
    )
    prior = prior_section(fit.mapping, fit.names)
    old = fit.mapping["uncertainty"]
    both = {kind: set(prior[kind]) - set(old[kind]) for kind in ("relative", "absolute")}
    # A parameter has the deviation of the number that it shares, and the rest keeps it.
    pair = "base.mounts.rear_axle.stiffness.0, base.mounts.rear_axle.stiffness.1"
    modulus = "links.lower_link.material.youngs_modulus"
    second = "base.mounts.rear_axle.stiffness.1"
    assert both == {"relative": {names[0], names[2], second}, "absolute": set()}
    gone = {kind: set(old[kind]) - set(prior[kind]) for kind in ("relative", "absolute")}
    assert gone == {"relative": {modulus, pair}, "absolute": set()}
    assert (prior["relative"][names[0]], prior["relative"][names[2]]) == (0.03, 0.2)
    assert prior["relative"][second] == 0.2
    assert prior["correlations"] == old["correlations"]
    mass = "rigid_bodies.implement.mass"
    result = fitted(fit, [2e11, 1.0, 6e5])
    result = replace(
        result,
        names=(*names, mass),
        values=np.append(result.values, 812.5),
        relative=np.array([True, True, True, True]),
        covariance=np.diag([1e-4, 4e-4, 9e-4, 25e-4])
        + 1e-4 * np.eye(4, k=2)
        + 1e-4 * np.eye(4, k=-2),
    )
    write_mechanism(fit, result, tmp_path / "fitted.yaml")
    assert "# old" not in (tmp_path / "fitted.yaml").read_text()
    new = sections(tmp_path / "fitted.yaml")[1]
    assert new["relative"] == dict(zip(result.names, [0.01, 0.02, 0.03, 0.05], strict=True))
    assert [pair["between"] for pair in new["correlations"]] == [
        [names[0], names[2]],
        [names[1], mass],
    ]
    assert new["correlations"][1]["value"] == pytest.approx(0.1)
    uncertainty = read_mechanism(tmp_path / "fitted.yaml").uncertainty
    assert uncertainty is not None
    assert {n.path: n.value for n in uncertainty.numbers}[mass] == 812.5


def test_residuals_that_are_too_large_count() -> None:
    """Targets that are claimed ten times too exact give the deviations that their scatter shows."""
    fit = measured_four_bar(1.05)
    errors = 0.01 * np.array([1.2, -0.8, 0.3, -1.1, 0.9, 0.4])
    targets = [
        replace(t, frequency=t.frequency * (1.0 + error), deviation=0.001)
        for t, error in zip(fit.targets, errors.tolist(), strict=True)
    ]
    bold = replace(fit, targets=tuple(targets))
    fair = replace(fit, targets=tuple(replace(t, deviation=0.01) for t in targets))
    first, second = calibrate(fair, starts=1), calibrate(bold, starts=1)
    assert first.scatter == 1.0
    assert 4.0 < second.scatter < 20.0
    shares = np.diag(second.covariance)[:2] / np.diag(first.covariance)[:2]
    assert (np.abs(np.log(shares)) < math.log(4.0)).all()
    assert "times as large as the deviations" in fit_report(bold, second)


def test_what_targets_leave_open_is_known_to_the_bounds(mapping: Any) -> None:
    """Numbers that have one effect together are known to their bounds, and their product better."""
    crank = mapping["links"]["input_crank"]
    crank["material"] = dict(crank["material"], density=1e-3)
    targets = measured(mechanism_from_mapping(mapping))
    width = Parameter("links.input_crank.section.width", 0.01, 0.1)
    both = calibration(mapping, targets, width, Parameter(MODULUS, 1e10, 1e12))
    result = calibrate(both, starts=1)
    assert result.undetermined
    widths = np.log([10.0, 100.0]) / math.sqrt(12.0)
    stddev = np.sqrt(np.diag(result.covariance))
    assert (stddev > 0.5 * widths.min()).all()
    assert (stddev < widths).all()
    assert result.covariance.sum() < 0.1**2


def test_extreme_of_a_parabola() -> None:
    """Three points around it give the vertex of a parabola exactly; at an end it is the value."""
    at = np.arange(7.0)
    for sign, lowest in ((1.0, True), (-1.0, False)):
        curve = sign * (3.0 + 0.5 * (at - 2.3) ** 2)
        assert _extreme(curve, lowest) == pytest.approx(sign * 3.0)
        assert _extreme(curve, not lowest) == curve[-1]
        assert _extreme(curve[3:], lowest) == curve[3]
    assert _extreme(np.full(5, 2.0), True) == 2.0


@pytest.mark.parametrize(("factor", "contradicts"), [(0.99, False), (1.01, True)])
def test_scatter_that_contradicts_the_deviations(factor: float, contradicts: bool) -> None:
    """It does beyond the 95 % quantile: 5.991 for five targets and three parameters, of a table.

    A number with a prior is one more residual and one more variable.
    """
    jacobian = np.eye(6, 4)
    fit = SimpleNamespace(jac=jacobian, cost=0.5 * factor * 5.991)
    expected = math.sqrt(factor * 5.991 / 2.0) if contradicts else 1.0
    assert _scatter(fit, 5, np.array([0, 1, 2])) == pytest.approx(expected)
    assert _scatter(fit, 3, np.array([0, 1, 2])) == 1.0  # no target is left to show scatter
    fit = SimpleNamespace(jac=jacobian, cost=0.5 * factor * 11.070)  # the quantile for five
    expected = math.sqrt(factor * 11.070 / 5.0) if contradicts else 1.0
    assert _scatter(fit, 5, np.array([], dtype=int)) == pytest.approx(expected)


@pytest.mark.parametrize(("slope", "count"), [(1.99, 1), (2.01, 0)])
def test_directions_that_targets_do_not_determine(slope: float, count: int) -> None:
    """The deviation of a logarithm is 1 / slope, which is too much above 0.5."""
    assert len(_undetermined(np.diag([100.0, slope]))) == count
    for share, names in ((0.29, [1]), (0.31, [0, 1])):
        direction = np.array([share, math.sqrt(1.0 - share**2)])
        across = np.array([-direction[1], direction[0]])
        [own] = _undetermined(np.array([100.0 * across, 0.1 * direction]))
        assert own.tolist() == names
    assert _undetermined(np.zeros((3, 0))) == []
    [first] = _undetermined(np.array([[100.0, 0.0]]))  # fewer targets than parameters
    assert first.tolist() == [1]


def test_what_the_report_says() -> None:
    """It has the deviations of parameters that are known, and says why others are not."""
    fit = four_bar()
    frequencies = np.array([1.02] * len(fit.targets))
    matrix, moved = np.diag([1e-4, 4e-4]), np.array([2.9, math.nan])
    stated = np.array([0.1, math.nan])
    more = {"frequencies": frequencies, "covariance": matrix, "stated": stated, "moved": moved}
    result = fitted(fit, [0.02, 0.03], **more)
    text = fit_report(fit, result)
    assert text.splitlines()[1].split() == ["mode", "1", "at", "45", "deg", "1", "1.02", "2.0%"]
    rows = [line.split()[1:] for line in text.splitlines() if line.startswith("links.")]
    assert rows == [["0.02", "10.0%", "+2.9", "1.0%"], ["0.03", "none", "2.0%"]]
    assert "times as large" not in text
    assert "stated deviations;" not in text
    assert "other number" not in text
    assert "on a bound" in fit_report(fit, replace(result, on_bound=(COUPLER,)))
    assert "unknown" in fit_report(fit, replace(result, undetermined=((ROCKER,),)))
    assert "are 1.5 times as large" in fit_report(fit, replace(result, scatter=1.5))
    far = replace(result, moved=np.array([-3.1, math.nan]))
    assert f"changes {COUPLER} by more than 3 stated" in fit_report(fit, far)


def test_small_correlations_are_not_written() -> None:
    """Those below a thousandth are left out, and rounding keeps the others positive definite."""
    covariance = np.array([[1.0, 0.0009, 0.5], [0.0009, 1.0, 0.0011], [0.5, 0.0011, 1.0]]) * 1e-4
    covariance[2] *= 100.0
    covariance[:, 2] *= 100.0
    actual = posterior_section(["a", "b", "c"], [True, True, False], covariance)
    assert actual["relative"] == {"a": 0.01, "b": 0.01}
    assert actual["absolute"] == {"c": 1.0}
    assert actual["correlations"] == [
        {"between": ["a", "c"], "value": 0.5},
        {"between": ["b", "c"], "value": 0.0011},
    ]
    exact = np.array([[1.0, 1.0], [1.0, 1.0]])
    [pair] = posterior_section(["a", "b"], [True, True], exact)["correlations"]
    assert 0.999998 < pair["value"] < 1.0
    wide = posterior_section(["a", "b"], [True, False], np.diag([4.0, 4.0]))
    assert wide == {"relative": {"a": 1.0}, "absolute": {"b": 2.0}}  # no relative one above 1


def test_correlations_of_claims_are_renamed() -> None:
    """Those of a number that a parameter shares are the parameter's; a second claim is dropped."""
    mapping = {
        "ground": {"P": [1.0, 2.0], "Q": [3.0, 4.0]},
        "uncertainty": {
            "relative": {"ground.P.0": 0.1, "ground.P.1": 0.2},
            "absolute": {"ground.Q.0": 0.3},
            "correlations": [
                {"between": ["ground.P.0", "ground.Q.0"], "value": 0.5},
                {"between": ["ground.P.1", "ground.Q.0"], "value": 0.4},
            ],
        },
    }
    both = "ground.P.0, ground.P.1"
    actual = prior_section(mapping, [both])
    assert actual["relative"] == {both: 0.1}
    assert actual["absolute"] == {"ground.Q.0": 0.3}
    assert actual["correlations"] == [{"between": [both, "ground.Q.0"], "value": 0.5}]


def test_targets_of_a_file(tmp_path: Path) -> None:
    """Angles are turned into radians, and a deviation that is not given is 1 %."""
    path = config_file("three_point_linkage.yaml")
    text = (
        f"mechanism: {path}\nparameters: {{{HEIGHT}: [0.02, 0.1]}}\n"
        "targets: [{mode: 2, at_deg: 90, hz: 3.5}, "
        "{mode: 3, over_the_stroke: lowest, hz: 4, deviation: 0.2}]\n"
    )
    (tmp_path / "fit.yaml").write_text(text)
    actual = read_calibration(tmp_path / "fit.yaml")
    assert actual.targets == (Target(2, math.pi / 2.0, 3.5, 0.01), Target(3, "lowest", 4.0, 0.2))
    assert actual.parameters == (Parameter(HEIGHT, 0.02, 0.1),)


def test_targets_of_blows_and_of_a_drive(tmp_path: Path, mapping: Any) -> None:
    """Targets of both are read from one file, each with its angle and its deviation.

    They are exact for an implement of 1000 kg, so its mass is found, and a mode that both measured
    at different heights leaves less uncertain than blows alone.
    """
    source, path = config_file("three_point_linkage.yaml"), tmp_path / "fit.yaml"
    heavier = LinkageModel(mechanism_from_mapping(with_numbers(mapping, [(MASS, 1000.0)])))
    texts = []
    for kind, degrees, deviation in (("blows", (95, 150), 0.002), ("a drive", (110, 165), 0.004)):
        solved = {angle: heavier.solve(math.radians(angle)) for angle in degrees}
        modes = [
            (
                ModelMode("vertical", mode),
                math.radians(angle),
                float(each.natural_frequencies[mode]),
                deviation,
            )
            for angle, each in solved.items()
            for mode in (0, 1)
        ]
        texts.append(targets_text(modes, source, path, kind))
    path.write_text(texts[0])
    blows = calibrate(read_calibration(path), starts=1)
    content, drive = map(yaml.safe_load, texts)
    content["targets"] += drive["targets"]
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    task = read_calibration(path)
    assert [(round(math.degrees(t.at)), t.deviation) for t in task.targets[::2]] == [
        (95, 0.002),
        (150, 0.002),
        (110, 0.004),
        (165, 0.004),
    ]
    both = calibrate(task, starts=1)
    assert both.values[both.names.index(MASS)] == pytest.approx(1000.0, rel=1e-3)
    assert (np.diag(both.covariance) < np.diag(blows.covariance)).all()


ROLL, YAW = "lateral.inertia.implement.roll", "lateral.inertia.implement.yaw"
PITCH = "rigid_bodies.implement.inertia"


def flat_task(deviation: float, targets: Sequence[Target] = ()) -> CalibrationTask:
    """Return a task of the shipped tractor, whose inertias of 200, 200 and 390 may change."""
    path = config_file("three_point_linkage_on_tractor.yaml")
    uncertainty = {"relative": {ROLL: deviation, YAW: deviation}}
    numbers = [(PITCH, 200.0), (ROLL, 200.0), (YAW, 390.0)]
    mapping = with_numbers(load_yaml(path)[0] | {"uncertainty": uncertainty}, numbers)
    parameters = (Parameter(PITCH, 66.0, 600.0),)
    return CalibrationTask(mapping, path.read_text(), parameters, tuple(targets))


@pytest.mark.parametrize(("deviation", "doubtful"), [(0.083, False), (0.081, True)])
def test_the_most_probable_inertias_of_a_body(deviation: float, doubtful: bool) -> None:
    """Of equal deviations, 200, 200 and 540 become r, r and 2 r with r^3 = 200^2 540 / 2.

    The distance by logarithms, 2 ln(r / 200)^2 + ln(2 r / 540)^2, is least there. Those of a body
    remain. Three deviations, each of 0.0817, are to be checked.
    """
    task = flat_task(deviation)
    unknowns = study._unknowns(task)
    information = np.diag([1.0 / deviation**2, 1.0, 1.0])  # by logarithms, and in deviations
    best = np.array([math.log(200.0), 0.0, math.log(540.0 / 390.0) / deviation])
    x, [doubt] = study._possible(task, unknowns, best, information)
    r = (200.0**2 * 270.0) ** (1.0 / 3.0)
    assert unknowns.values(x) == pytest.approx([r, r, 2.0 * r], rel=2e-4)
    away = math.sqrt(2.0 * math.log(r / 200.0) ** 2 + math.log(2.0 * r / 540.0) ** 2) / deviation
    assert f"by {away:.2g} deviations" in doubt
    assert ("Check the inertias" in doubt) == doubtful
    for inertia, kept in ((399.9, True), (400.1, False)):
        best[2] = math.log(inertia / 390.0) / deviation
        assert (study._possible(task, unknowns, best, information)[0] == best).all() == kept


@pytest.mark.parametrize("bodies", [True, False])
def test_a_fit_whose_inertias_are_of_no_body(tmp_path: Path, bodies: bool) -> None:
    """It is not lost: inertias of a flat body are written, and the report says so.

    Where the bounds permit no body, it says that other commands refuse the mechanism.
    """
    task = flat_task(0.2)
    exact = {key: value for key, value in task.mapping.items() if key != "uncertainty"}
    numbers = with_numbers(exact, [(PITCH, 220.0), (ROLL, 220.0), (YAW, 480.0)])
    truth = mechanism_from_mapping(numbers, drawn=True)
    asked = [Target(i, 2.3, 1.0, 0.003, half) for half in HALVES for i in (1, 2, 3, 4)]
    hertz = _natural_frequencies(LinkageModel(coarser(truth, 10, 4)), asked)
    targets = tuple(replace(each, frequency=f) for each, f in zip(asked, hertz, strict=True))
    task = replace(task, targets=targets)
    if not bodies:  # 200 and 390 kg m2 remain, and the third one is too small
        task = replace(task, mapping=exact, parameters=(Parameter(PITCH, 66.0, 180.0),))
    result = calibrate(task, starts=1)
    text, path = fit_report(task, result), tmp_path / "fitted.yaml"
    write_mechanism(task, result, path)
    if not bodies:
        assert "Other commands refuse the fitted mechanism. lateral.inertia.implement.yaw" in text
        return
    fitted = read_mechanism(path)
    assert fitted.lateral is not None
    roll, yaw = dict(fitted.lateral.inertia)["implement"]
    assert yaw == pytest.approx(roll + fitted.rigid_bodies[0].inertia, rel=2e-4)
    assert "inertias of no body" in text
    assert np.abs(np.log(result.frequencies / hertz)).max() < 3 * 0.003
