# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Times the frames of the page of a long log: ``python -m benchmark.review_page [MINUTES]``.

A headless Chromium receives the input of a person. Each frame that answers it is timed from its
first callback until the page's thread is free again, when everything is laid out and painted.
"""

import random
import resource
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from tqdm import tqdm

from benchmark.paper_linkage import PARAMETERS
from benchmark.report import machine, publish, table
from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.writing import Topic, offered_qos_profiles
from linkage_vibration.playback.replay import replay
from linkage_vibration.review.html import page_parts
from linkage_vibration.review.log import read_log
from linkage_vibration.review.review_page import review_page
from linkage_vibration.support.resources import config_file
from test.support.browser import Browser
from test.support.drive import DURATION, ENGINE_SPEED, JOINTS, RATE

MINUTES = 60.0
FRAME = 1000.0 / 60.0  # ms
WIDTH, HEIGHT = 1920, 1080
GESTURES, STEPS = 24, 20  # gestures of each kind, and steps of each gesture
CTRL, SHIFT = 2, 8  # modifiers of DevTools
CHART = "#chart-modes .u-over"
Place = Callable[[float], tuple[float, float]]  # from a share of the chart's width to a point
Gesture = Callable[[Browser, Place, random.Random, int], None]
COLUMNS = ["input", "frames", "median [ms]", "90 % [ms]", "99 % [ms]", "longest [ms]", "late"]
TIMER = """
(() => {
  const own = requestAnimationFrame.bind(window), channel = new MessageChannel();
  let answered = "", shown = "", frame = 0, begun = 0;
  window.timed = [];
  for (const kind of ["pointermove", "pointerup", "wheel"])
    addEventListener(kind, () => { answered = kind; }, { capture: true, passive: true });
  channel.port1.onmessage = () => timed.push([shown, performance.now() - begun]);
  window.requestAnimationFrame = callback => own(now => {
    if (answered && now !== frame) {
      shown = answered;
      begun = performance.now();
      channel.port2.postMessage(null);  // arrives when the frame is done
    }
    frame = now;
    answered = "";
    callback(now);
  });
})();
"""


def main() -> None:
    """Make the page, use it, and publish the times of its frames."""
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else MINUTES
    with tempfile.TemporaryDirectory() as name:
        bag, log, page = (Path(name) / f for f in ("bag.mcap", "log.mcap", "page.html"))
        write_bag(bag, minutes)
        predictions = replay([bag], log, PARAMETERS).predictions
        making = timed(lambda: page.write_bytes(b"".join(page_parts(review_page(read_log(log))))))
        took, peak = commanded(log, page)
        size = page.stat().st_size
        with Browser(WIDTH, HEIGHT) as browser:
            browser.send("Page.addScriptToEvaluateOnNewDocument", source=TIMER)
            opening = timed(lambda: browser.open(page))
            kept = browser.evaluate("review.n")
            product = browser.send("Browser.getVersion")["product"].replace("/", " ")
            rows = [
                row(label, used(browser, gesture, event))
                for label, gesture, event in (
                    ("hover: move the cursor", hover, "pointermove"),
                    ("Shift and drag: pan", pan, "pointermove"),
                    ("Ctrl and wheel: zoom", zoom, "wheel"),
                    ("drag or double-click: zoom in or show all", window, "pointerup"),
                )
            ]
            assert not browser.problems, browser.problems
    publish(
        "review_page",
        "Review page",
        [
            "This page shows how smoothly the review page of a long log answers the mouse. The log "
            f"has {minutes:g} min at {RATE} Hz, with {predictions} predictions and resonances; its "
            f"page of {size / 1e6:.1f} MB contains {kept} of them. The page was made in "
            f"{making:.1f} s and opened in {opening:.1f} s. The command `linkage-vibration review` "
            f"took {took:.1f} s from its start, with a peak memory of {peak:.0f} MiB.",
            f"Each row is for the frames that answer one kind of input in {product} without a GPU, "
            f"at {WIDTH} x {HEIGHT}, while the linkage is animated. The time is that of the page's "
            "thread, from the first callback of a frame to the end of painting. Other threads "
            f"rasterise and compose the tiles. A frame is late if it takes more than {FRAME:.1f} "
            "ms, the period of 60 Hz.",
            table(COLUMNS, rows),
        ],
        machine(product),
    )


def timed(do: Callable[[], object]) -> float:
    """Return the time that a call takes, s."""
    begin = time.perf_counter()
    do()
    return time.perf_counter() - begin


def commanded(log: Path, page: Path) -> tuple[float, float]:
    """Return the time of the command ``review``, s, and its peak memory, MiB."""
    command = [sys.executable, "-m", "linkage_vibration.cli", "review", str(log), "-o", str(page)]
    took = timed(lambda: subprocess.run(command, check=True))
    return took, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0


def write_bag(path: Path, minutes: float) -> None:
    """Write repetitions of the shipped drive, with an engine that becomes slower."""
    with config_file("drives/hitch_duty_cycle.mcap").open("rb") as file:
        messages = [
            (schema, channel.topic, message.log_time, message.data)
            for schema, channel, message in make_reader(file).iter_messages()
        ]
    qos = offered_qos_profiles()
    kinds = {topic: schema for schema, topic, *_ in messages if schema is not None}
    topics = [
        Topic(topic, schema.name, schema.data.decode(), "", qos) for topic, schema in kinds.items()
    ]
    rounds = round(60.0 * minutes / DURATION)
    with LogWriter(path, topics) as log:
        for k in tqdm(range(rounds), unit="round"):
            for _, topic, first, data in messages:
                now = first + round(k * DURATION * 1e9)
                if topic == JOINTS:
                    data = data[:4] + struct.pack("<II", *divmod(now, 10**9)) + data[12:]
                elif topic == ENGINE_SPEED:
                    [speed] = struct.unpack_from("<d", data, 4)
                    data = data[:4] + struct.pack("<d", speed * (1.0 - 0.2 * k / rounds))
                log.write(topic, data, now, now)


def row(label: str, frames: list[float]) -> list[str]:
    """Return a row of the table."""
    times = [f"{value:.1f}" for value in np.percentile(frames, [50, 90, 99, 100])]
    late = sum(took > FRAME for took in frames) / len(frames)
    return [label, f"{len(frames)}", *times, f"{100 * late:.0f} %"]


def used(browser: Browser, gesture: Gesture, answered: str) -> list[float]:
    """Make a gesture many times; return the times (ms) of the frames that answer its events."""
    browser.place(CHART)  # scroll it into view
    left, top, width, height = browser.evaluate(
        f"(b => [b.left, b.top, b.width, b.height])(document.querySelector('{CHART}')"
        ".getBoundingClientRect())"
    )
    browser.evaluate("timed.length = 0")
    rng = random.Random(1)
    for k in tqdm(range(GESTURES), desc=gesture.__name__):
        press(browser, "all")

        def at(across: float) -> tuple[float, float]:
            return left + across * width, top + 0.5 * height

        gesture(browser, at, rng, k)
    return [took for kind, took in browser.evaluate("timed") if kind == answered]


def hover(browser: Browser, at: Place, rng: random.Random, k: int) -> None:
    """Move over the chart, one step per frame, in views from the whole log to one second."""
    for _ in range(k % 12):
        press(browser, "in")
    for _ in range(STEPS):
        browser.mouse("mouseMoved", at(rng.uniform(0.01, 0.99)))
        browser.settle()


def pan(browser: Browser, at: Place, rng: random.Random, k: int) -> None:
    """Drag the chart to one side and back, in views from half the log to one second."""
    for _ in range(1 + k % 11):
        press(browser, "in")
    browser.mouse("mouseMoved", at(0.5), modifiers=SHIFT)
    browser.mouse("mousePressed", at(0.5), modifiers=SHIFT)
    for i in range(STEPS):
        across = 0.5 + 0.4 * np.sin(2.0 * np.pi * (i + 1) / STEPS)
        browser.mouse("mouseMoved", at(across), buttons=1, modifiers=SHIFT)
        browser.settle()
    browser.mouse("mouseReleased", at(0.5), modifiers=SHIFT)


def zoom(browser: Browser, at: Place, rng: random.Random, k: int) -> None:
    """Zoom in by the wheel until a few seconds are visible, and out again."""
    about = at(rng.uniform(0.1, 0.9))
    for i in range(STEPS):
        delta = -120 if i < STEPS // 2 else 120
        browser.mouse("mouseWheel", about, deltaX=0, deltaY=delta, modifiers=CTRL)
        browser.settle()


def window(browser: Browser, at: Place, rng: random.Random, k: int) -> None:
    """Zoom to smaller and smaller windows, and return to the whole log."""
    for _ in range(3):
        ends = sorted(rng.uniform(0.05, 0.95) for _ in range(2))
        browser.drag(at(ends[0]), at(ends[1] + 0.04))
        browser.settle()
    browser.click(at(0.5), count=2)


def press(browser: Browser, button: str) -> None:
    """Press a button of the toolbar; its frames are not timed."""
    browser.evaluate(f"document.querySelector('[data-do={button}]').click()")
    browser.settle()


if __name__ == "__main__":
    main()
