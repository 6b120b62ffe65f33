# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A Watt six-bar with a strong damper, whose third and fourth mode change places at 104 deg."""

WATT = """
name: watt_six_bar
ground: {A: [0.0, 0.0], D: [0.60, 0.05], G: [-0.30, 0.55]}
rigid_bodies:
  plate:
    points: {C: [0.0, 0.0], D: [0.5, 0.0], E: [0.25, 0.3]}
    centre_of_gravity: [0.9, -0.7]
    mass: 35.0
    inertia: 0.02
  tool:
    points: {G: [0.0, 0.0], F: [0.45, 0.0], H: [0.4, 0.3]}
    centre_of_gravity: [0.2, 0.5]
    mass: 120.0
    inertia: 9.0
links:
  coupler:
    points: {B: 0.0, C: 0.55}
    section: {shape: rectangle, width: 0.03, height: 0.04}
    material: &steel {youngs_modulus: 210.0e+9, density: 7800.0, poisson_ratio: 0.3}
  rod:
    points: {E: 0.0, F: 0.5}
    section: {shape: tube, outer_diameter: 0.05, inner_diameter: 0.03}
    material: *steel
    count: 2
  crank:
    points: {A: 0.0, B: 0.2}
    section: {shape: rectangle, width: 0.03, height: 0.05}
    material: *steel
    masses: {B: 2.5}
springs:
  hold: {joint: A, stiffness: 6.0e+4, loss_factor: {factor: 0.2, at_hz: 8.0}}
  pin: {joint: C, damping: 15.0}
  pull: {between: [D, H], stiffness: 3.0e+5, damping: 900.0}
input: {link: crank, range_deg: [95.0, 110.0]}
assembly:
  alpha3_deg: 90.0
  angles_deg: {plate: 60.0, coupler: 10.0, rod: 150.0, tool: 70.0}
damping: {rule: modal_ratio, ratio: 0.01}
response: {drive_point: F, direction: x, band_hz: [0.0, 600.0], modes: 4}
uncertainty:
  relative:
    rigid_bodies.plate.mass: 0.15
    rigid_bodies.tool.inertia: 0.2
    springs.hold.stiffness: 0.25
    springs.pull.damping: 0.3
    springs.pull.stiffness: 0.2
    links.coupler.section.height: 0.1
  absolute: {rigid_bodies.tool.centre_of_gravity.0: 0.05, ground.G.0: 0.003}
"""
