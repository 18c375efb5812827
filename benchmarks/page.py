"""The page with many rows: python -m benchmarks.page [--rows 100000 1000000]

A street of people who come and go, in a headless Chromium without a graphics card: all drawing is
done by the processor, so a desktop is faster. For each number of rows the scene is served and
opened: seconds to the first paint and until the rows are drawn, then three things are done, one
step for each frame: the time is moved (scrub), the plan is moved with the mouse (pan), and zoomed.
Printed are frames a second, and milliseconds of script in a frame: the median and the slowest of
twenty. Memory is that of the tab's process at the end.
"""

import argparse
import shutil
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright

from benchmarks.tables import machine, markdown
from scene4d.app import ServeOptions, application
from scene4d.app._server import Server
from scene4d.app.serving import _socket
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.tracks import Tracks
from scene4d.store.writing import SceneWriter

RATE_HZ, TRACK_S = 10, 40
DAY_S = 86_400.0
ROWS = (100_000, 1_000_000)
FRAMES = 120
CAMERA = Camera.from_pose(
    image_size=(1280, 720), focal_px=1000.0, tilt_rad=0.35, roll_rad=0.0, height_m=7.0
)
TARGETS = "first paint 2 s, scrubbing 30 frames a second, 500 MB"
PROBE = """
window.spent = [];
const wait = window.requestAnimationFrame.bind(window);
let frame = null;
window.requestAnimationFrame = (work) => wait((time) => {
  const begun = performance.now();
  work(time);
  const took = performance.now() - begun;
  if (frame === time) window.spent[window.spent.length - 1] += took;
  else window.spent.push(took);
  frame = time;
});
window.stepped = (count, step) => new Promise((done) => {
  const times = [];
  window.spent.length = 0;
  const next = (time) => {
    times.push(time);
    if (times.length > count) return done({ times, spent: window.spent });
    step(times.length / count);
    wait(next);
  };
  wait(next);
});
window.at = (id, x, y) => {
  const box = document.getElementById(id).getBoundingClientRect();
  const [clientX, clientY] = [box.left + x * box.width, box.top + y * box.height];
  return { clientX, clientY, bubbles: true, cancelable: true, buttons: 1 };
};
window.send = (id, kind, x, y, more = {}) => {
  const make = kind === "wheel" ? WheelEvent : PointerEvent;
  const said = { ...window.at(id, x, y), pointerId: 1, pointerType: "mouse", ...more };
  document.getElementById(id).dispatchEvent(new make(kind, said));
};
"""
"""Counts what the page does in each frame; ``stepped`` does one step for each of them."""
STEPS = {
    "scrub": "(share) => send('timeline', 'pointermove', 0.02 + 0.96 * share, 0.8)",
    "pan": "(share) => send('plan', 'pointermove', 0.5 + 0.3 * Math.sin(9 * share), 0.5)",
    "zoom": "(share) => send('plan', 'wheel', 0.5, 0.5, { deltaY: 60 * Math.cos(9 * share) })",
}


def crowd(rows: int) -> Tracks:
    """People who walk for 40 s somewhere in view, spread over a day."""
    rng = np.random.default_rng(0)
    n = RATE_HZ * TRACK_S
    people = rows // n
    begin = np.sort(rng.uniform(0, DAY_S, people))
    start = rng.uniform((-8.0, 10.0), (8.0, 40.0), (people, 2))
    speed = rng.normal(0, 0.5, (people, 2))
    who = np.repeat(np.arange(people), n)
    step = np.tile(np.arange(n), people) / RATE_HZ
    turn = 2 * np.sin(step / 6 + who)[:, None]
    xy = start[who] + speed[who] * step[:, None] + turn + rng.normal(0, 0.03, (len(who), 2))
    foot, _ = CAMERA.project(np.column_stack([xy, np.zeros(len(xy))]))
    head, _ = CAMERA.project(np.column_stack([xy, np.full(len(xy), 1.7)]))
    wide = 0.2 * (foot[:, 1] - head[:, 1])
    spread = np.tile(0.02 * np.eye(2), (len(who), 1, 1))
    return Tracks(
        track=who,
        class_name=np.where(who % 5 == 0, "car", "person"),
        time_s=begin[who] + step,
        frame=np.rint((begin[who] + step) * RATE_HZ).astype(int),
        xy_m=xy,
        covariance_m2=spread,
        shared_covariance_m2=spread,
        velocity_mps=speed[who],
        velocity_covariance=spread,
        heading_rad=np.arctan2(*speed[who].T[::-1]),
        heading_sigma_rad=np.full(len(who), 0.1),
        box_xyxy=np.column_stack([foot[:, 0] - wide, head[:, 1], foot[:, 0] + wide, foot[:, 1]]),
        keypoint_uv=np.zeros((len(who), 0, 2)),
        keypoint_score=np.zeros((len(who), 0)),
        score=np.full(len(who), 0.9),
        observed=np.ones(len(who), bool),
    )


def write(folder: Path, rows: int) -> None:
    with SceneWriter(
        folder,
        camera="street",
        run="day",
        start_utc=datetime(2026, 11, 20, tzinfo=UTC),
        camera_json=Calibration.of_camera(CAMERA).to_dict(),
        provenance={"rate_hz": RATE_HZ},
    ) as writer:
        writer.write(crowd(rows))


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of a server of the scene."""
    options = ServeOptions(port=0)
    app, holder = application([folder], options)
    server = Server(app, holder)
    with _socket(options) as taken:
        thread = threading.Thread(target=server.run, kwargs={"sockets": [taken]}, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{taken.getsockname()[1]}/"
        server.should_exit = True
        thread.join(20)
    holder.close()


def tab_mb() -> float:
    """Resident memory of the largest process that draws pages."""
    found = [0.0]
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if b"--type=renderer" in (folder / "cmdline").read_bytes():
                pages = int((folder / "statm").read_text().split()[1])
                found.append(pages * 4096 / 1e6)
        except OSError:  # it has ended
            continue
    return max(found)


def moved(page: Page, what: str) -> dict[str, str]:
    """Frames a second, and script in each frame (ms): the median and the slowest of twenty."""
    pane = "timeline" if what == "scrub" else "plan"
    page.evaluate(f"send('{pane}', 'pointerdown', 0.5, 0.5)")
    said = page.evaluate(f"stepped({FRAMES}, {STEPS[what]})")
    page.evaluate(f"send('{pane}', 'pointerup', 0.5, 0.5, {{ buttons: 0 }})")
    spent = np.array(said["spent"])
    return {
        f"{what}: frames/s": f"{1000 * FRAMES / (said['times'][-1] - said['times'][0]):.0f}",
        f"{what}: ms": f"{np.median(spent):.1f}, {np.quantile(spent, 0.95):.1f}",
    }


def opened(browser: Browser, url: str, tracks: int) -> dict[str, str]:
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.set_default_timeout(120_000)
    page.add_init_script(PROBE)
    begun = time.perf_counter()
    page.goto(url, wait_until="commit")
    all_there = page.locator("#tracks-count", has_text=f"{tracks} of {tracks} tracks")
    all_there.wait_for(state="attached")
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    there = time.perf_counter() - begun
    paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    said = {"first paint, s": f"{paint / 1000:.2f}", "rows drawn, s": f"{there:.2f}"}
    for what in STEPS:
        said |= moved(page, what)
    said["memory, MB"] = f"{tab_mb():.0f}"
    page.close()
    return said


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, nargs="+", default=ROWS)
    arguments = parser.parse_args()
    table: list[dict[str, str]] = []
    with tempfile.TemporaryDirectory() as name, sync_playwright() as play:
        for rows in arguments.rows:
            folder = Path(name) / f"{rows}"
            write(folder, rows)
            browser = play.chromium.launch(
                executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
            )
            with served(folder) as url:
                said = opened(browser, url, rows // (RATE_HZ * TRACK_S))
                table.append({"rows": f"{rows:,}"} | said)
            browser.close()
    print(f"{machine()}; software rendering; to reach: {TARGETS}\n")
    print(markdown([list(table[0]), *(list(one.values()) for one in table)]))


if __name__ == "__main__":
    main()
