# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The markers over real DDS: the linkage, a mode's movement, and nothing without a viewer."""

import math
import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from visualization_msgs.msg import Marker, MarkerArray

from linkage_vibration.drawing.geometry import curves, size
from linkage_vibration.prediction.answers import Served
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.ros.markers import SWING, Markers
from test.support.ros_process import LIMIT, own_context, until
from test.support.served import shipped

ANGLE = 2.3


@dataclass
class Viewer:
    """A node that draws, spun in a thread, and a node that may subscribe."""

    markers: Markers
    served: Served
    look: Callable[[], Any]
    look_away: Callable[[Any], None]
    spin: Callable[[float], None]
    asked: list[Served] = field(default_factory=list)
    pictures: list[Any] = field(default_factory=list)

    def next(self, good: Callable[[Any], bool] = lambda _: True) -> Any:
        """Return the next picture of a kind."""
        self.pictures.clear()
        until(lambda: any(map(good, self.pictures)), "a picture", self._turn)
        return next(filter(good, self.pictures))

    def _turn(self) -> None:
        self.markers.watch()  # as the node does every second
        self.spin(0.05)


@pytest.fixture
def viewer(domain: int) -> Iterator[Viewer]:
    """Return a node that draws the shipped linkage with its second mode."""
    with own_context(domain) as context:
        drawing, looking = (
            rclpy.create_node(name, context=context, start_parameter_services=False)
            for name in ("drawing", "looking")
        )
        served, asked = shipped(), list[Served]()

        def ask() -> Served:
            asked.append(served)
            return served

        markers = Markers(
            drawing, ask, Parameters(marker_mode="", marker_rate=20.0, marker_frame="hitch")
        )
        executors = [SingleThreadedExecutor(context=context) for _ in range(2)]
        executors[0].add_node(drawing)
        executors[1].add_node(looking)
        thread = threading.Thread(target=executors[0].spin)
        thread.start()
        viewer = Viewer(
            markers,
            served,
            lambda: looking.create_subscription(
                MarkerArray,
                "drawing/markers",
                lambda m: viewer.pictures.append(m),  # type: ignore[attr-defined]
                10,
            ),
            looking.destroy_subscription,
            executors[1].spin_once,
            asked,
        )
        yield viewer
        executors[0].shutdown()
        thread.join(LIMIT)
        markers.close()
        for node in (drawing, looking):
            node.destroy_node()


def by_name(picture: Any) -> dict[tuple[str, int], Any]:
    """Return the markers of a picture by what identifies them."""
    found = {(marker.ns, marker.id): marker for marker in picture.markers}
    assert len(found) == len(picture.markers)
    return found


def places(marker: Any) -> Any:
    """Return a marker's points, (n, 2); all are in the plane of motion."""
    assert all(point.y == 0.0 for point in marker.points)
    return np.array([[point.x, point.z] for point in marker.points])


def test_nothing_is_drawn_without_a_subscriber(viewer: Viewer) -> None:
    """Without a subscriber or an angle nothing is drawn."""
    timer = viewer.markers._timer
    viewer.markers.update(ANGLE)
    viewer.markers.watch()
    assert timer.is_canceled()
    viewer.markers.update(math.nan)
    looking = viewer.look()
    until(lambda: not timer.is_canceled(), "the subscriber", viewer.markers.watch)
    viewer.markers._on_timer()
    assert viewer.asked == []
    viewer.markers.update(ANGLE)
    viewer.next()
    assert viewer.asked
    viewer.look_away(looking)
    until(timer.is_canceled, "the end of drawing")


def test_picture(viewer: Viewer) -> None:
    """Bodies are where the kinematics put them, and the mode swings about them by SWING."""
    viewer.look()
    viewer.markers.update(ANGLE)
    model = viewer.served.model
    at_rest = curves(model, model.kinematics.at(ANGLE))
    most = SWING * size(at_rest)
    swings, names = [0.7 * most], set()
    while max(swings) < 0.8 * most or min(swings) > 0.5 * most:
        picture = viewer.next()
        found = by_name(picture)
        names.add(tuple(sorted(found)))
        for i, curve in enumerate(at_rest.values()):
            np.testing.assert_array_equal(places(found["bodies", i]), curve)
        moved = [places(found["mode", i]) - curve for i, curve in enumerate(at_rest.values())]
        swings.append(max(np.linalg.norm(m, axis=1).max() for m in moved))
        for marker in picture.markers:
            assert marker.header.frame_id == "hitch"
            assert marker.header.stamp.sec > 0
            assert marker.lifetime.nanosec == 150_000_000
            assert (marker.action, marker.color.a) == (Marker.ADD, 1.0)
            assert marker.scale.x > 0.0
    assert len(names) == 1  # the same markers in every picture
    assert {ns for ns, _ in next(iter(names))} == {
        "bodies",
        "joints",
        "ground",
        "centres_of_gravity",
        "mode",
        "mode_text",
    }
    assert max(swings) <= most * (1.0 + 1e-9)
    frequency = viewer.served.predictor.predict(ANGLE).natural_frequencies[3]
    assert found["mode_text", 0].text == f"mode 4 (implement heave): {frequency:.1f} Hz"


def test_other_settings(viewer: Viewer) -> None:
    """Mode, rate and frame can change; without a mode or outside the table no mode is drawn."""
    assert viewer.markers._timer.is_canceled()  # without a subscriber
    viewer.look()
    viewer.markers.update(ANGLE)
    viewer.next()
    assert viewer.markers._timer.timer_period_ns == 10**9 // 20
    viewer.markers.settings = Parameters(marker_mode="0", marker_rate=50.0, marker_frame="tractor")
    picture = viewer.next(lambda p: p.markers[0].header.frame_id == "tractor")
    assert "mode" not in {marker.ns for marker in picture.markers}
    until(lambda: viewer.markers._timer.timer_period_ns == 10**9 // 50, "50 pictures in a second")
    assert picture.markers[0].lifetime.nanosec == 60_000_000
    viewer.markers.settings = Parameters(marker_mode="1", marker_rate=50.0, marker_frame="tractor")
    viewer.next(lambda p: "mode" in {marker.ns for marker in p.markers})
    viewer.markers.settings = Parameters(marker_mode="7", marker_rate=50.0, marker_frame="tractor")
    viewer.next(lambda p: "mode" not in {marker.ns for marker in p.markers})
    viewer.markers.settings = Parameters(marker_mode="1", marker_rate=50.0, marker_frame="tractor")
    viewer.markers.update(3.3)  # the linkage closes there, but the table ends before it
    viewer.next(lambda p: "mode" not in {marker.ns for marker in p.markers})
    viewer.markers.update(5.0)  # the linkage does not close there
    received = -1
    while len(viewer.pictures) > received:  # those that were drawn before may still arrive
        received, enough = len(viewer.pictures), len(viewer.asked) + 10
        until(lambda n=enough: len(viewer.asked) > n, "attempts to draw", lambda: viewer.spin(0.1))


def test_mode_keeps_its_sign(viewer: Viewer) -> None:
    """While the linkage moves, the drawn mode changes smoothly and never its sign."""
    viewer.look()
    before = None
    for angle in np.linspace(1.7, 3.0, 30):
        viewer.markers.update(float(angle))
        viewer.next()
        shape = viewer.markers._before
        assert shape is not None
        if before is not None:
            assert float((shape * before).sum()) > 0.0
        before = shape


def test_drawn(viewer: Viewer, tmp_path: Path) -> None:
    """A picture with every marker can be drawn with equal axes, as a viewer does."""
    figures = pytest.importorskip("matplotlib.figure")
    viewer.look()
    viewer.markers.update(ANGLE)
    picture = viewer.next()
    figure = figures.Figure(figsize=(7, 6), dpi=100)
    axes = figure.subplots()
    axes.set_aspect("equal")
    for marker in picture.markers:
        colour = (marker.color.r, marker.color.g, marker.color.b)
        if marker.type == Marker.TEXT_VIEW_FACING:
            position = marker.pose.position
            axes.text(position.x, position.z, marker.text, color=colour, ha="center")
        elif marker.type == Marker.LINE_STRIP:
            axes.plot(*places(marker).T, color=colour, lw=1.0 if marker.ns == "mode" else 3.0)
        else:
            kind = "s" if marker.type == Marker.CUBE_LIST else "o"
            axes.plot(*places(marker).T, kind, color=colour, markersize=7)
    target = Path(os.environ.get("MARKERS_PNG", tmp_path / "markers.png"))
    figure.savefig(target)
    assert target.stat().st_size > 5_000
