"""Draw docs/images/predicates.png: every predicate over what it depends on, from the code."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from scene4d.core.body import HALPE26
from scene4d.core.tracks import Tracks
from scene4d.searching.predicates import Stage
from scene4d.searching.predicates._registry import PREDICATES

BLUE, RED, GREEN, ORANGE = "#1f5fa8", "#c0392b", "#1e8449", "#d68910"
STEP_S = 0.2
SURE, UNSURE = 0.05, 0.7
"""Standard deviations of positions (m) and velocities (m/s): solid and dashed lines."""


def stage_of(*objects: dict, sigma: float = SURE, **places) -> Stage:
    """Objects with columns ``xy``, and where they matter ``t``, ``v``, ``heading``, ``box``,
    ``joints``; one row each or many.
    """

    def column(name: str, width: tuple[int, ...]) -> np.ndarray:
        parts = []
        for o in objects:
            shape = (len(o["xy"]), *width)
            parts.append(np.broadcast_to(np.asarray(o.get(name, np.nan), float), shape))
        return np.concatenate(parts)

    sizes = [len(o["xy"]) for o in objects]
    n, joints = sum(sizes), column("joints", (26, 2))
    covariance = np.tile(sigma**2 * np.eye(2), (n, 1, 1))
    time = np.concatenate(
        [o.get("t", np.arange(k) * STEP_S) for o, k in zip(objects, sizes, strict=True)]
    )
    heading = column("heading", ())
    tracks = Tracks(
        track=np.repeat(np.arange(len(objects)), sizes),
        class_name=np.full(n, "person"),
        time_s=time,
        frame=np.rint(time / STEP_S).astype(int),
        xy_m=column("xy", (2,)),
        covariance_m2=covariance,
        shared_covariance_m2=np.zeros((n, 2, 2)),
        velocity_mps=column("v", (2,)),
        velocity_covariance=covariance,
        heading_rad=heading,
        heading_sigma_rad=np.where(np.isnan(heading), np.nan, 0.1),
        box_xyxy=column("box", (4,)),
        keypoint_uv=joints,
        keypoint_score=np.isfinite(joints).all(axis=2).astype(float),
        score=np.ones(n),
        observed=np.ones(n, bool),
    )
    return Stage(tracks, (1280, 720), STEP_S, **places)


def line(ax, x, name: str, values, colour: str, dashed: bool, label: str | None = None) -> None:
    ax.plot(
        x,
        values,
        color=colour,
        ls="--" if dashed else "-",
        lw=1.8,
        label=None if dashed else label or name,
    )


def both(ax, x, names: tuple[str, ...], make: Callable[[float], tuple[dict, ...]]) -> None:
    """Lines of predicates whose rows run along x, for small and large errors."""
    for sigma in (SURE, UNSURE):
        objects = make(sigma)
        stage = stage_of(*objects, sigma=sigma)
        rows = np.arange(len(stage.tracks)).reshape(len(objects), -1)
        for name, colour in zip(names, (BLUE, RED, GREEN, ORANGE), strict=False):
            p = PREDICATES[name]
            values = p.function(*(stage.rows(r) for r in rows[: p.arity]))
            line(ax, x, name, values, colour, sigma == UNSURE)


def ground(ax) -> None:
    d = np.linspace(0, 10, 200)
    zero = np.zeros((200, 2))
    both(
        ax,
        d,
        ("near", "far", "same_place"),
        lambda s: ({"xy": zero}, {"xy": np.column_stack([d, 0 * d])}),
    )
    ax.set(xlabel="distance, m")


def speeds(ax) -> None:
    v = np.linspace(0, 5, 200)
    velocity = np.column_stack([v, 0 * v])
    names = ("moving", "stationary", "speed_above", "speed_below")
    both(ax, v, names, lambda s: ({"xy": velocity, "v": velocity},))
    ax.set(xlabel="speed, m/s")


def directions(ax) -> None:
    angle = np.linspace(-180, 180, 361)
    velocity = 1.3 * np.column_stack([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    zero = np.zeros((361, 2))
    both(
        ax,
        angle,
        ("moving_towards", "moving_away"),
        lambda s: ({"xy": zero, "v": velocity}, {"xy": np.add(zero, [5.0, 0.0])}),
    )
    ax.set(xlabel="direction of motion against that to b, °, at 1.3 m/s")


def followers(ax) -> None:
    d = np.linspace(-5, 15, 300)
    walking, zero = np.full((300, 2), [1.3, 0.0]), np.zeros((300, 2))
    both(
        ax,
        d,
        ("following",),
        lambda s: (
            {"xy": zero, "v": walking},
            {"xy": np.column_stack([d, 0 * d + 0.5]), "v": walking},
        ),
    )
    ax.set(xlabel="b walks so far ahead of a, m")


def looks(ax) -> None:
    off = np.linspace(-180, 180, 361)
    zero = np.zeros((361, 2))
    both(
        ax,
        off,
        ("facing",),
        lambda s: ({"xy": zero, "heading": np.radians(off)}, {"xy": np.add(zero, [2.0, 0.0])}),
    )
    ax.set(xlabel="heading against direction to b 2 m away, °")


def sides(ax) -> None:
    bearing = np.linspace(-180, 180, 361)
    a = np.radians(bearing)
    place = np.column_stack([3.2 * np.cos(a), 1.9 * np.sin(a)])
    for sigma in (SURE, UNSURE):
        stage = stage_of({"xy": place}, {"xy": np.zeros((361, 2)), "heading": 0.0}, sigma=sigma)
        rows = np.arange(722).reshape(2, -1)
        for side, colour in zip(
            ("front", "back", "left", "right"), (BLUE, RED, GREEN, ORANGE), strict=True
        ):
            values = PREDICATES["facing"].function(*map(stage.rows, rows), side=side)
            line(ax, bearing, "facing", values, colour, sigma == UNSURE, f"facing, side={side}")
    ax.set(xlabel="a goes round the vehicle b (0: ahead, 90: left), °")


def arc(speed: float, rate: float, seconds: float) -> dict:
    t = np.arange(0, seconds + 0.1, STEP_S)
    v = speed * np.column_stack([np.cos(rate * t), np.sin(rate * t)])
    return {"xy": np.cumsum(v, axis=0) * STEP_S, "v": v, "t": t}


def turns(ax) -> None:
    rates = np.linspace(-0.5, 0.5, 81)
    for sigma in (SURE, UNSURE):
        for name, colour in (("turning_left", BLUE), ("turning_right", RED)):
            values = []
            for rate in rates:
                stage = stage_of(arc(4.0, rate, 4.0), sigma=sigma)
                values.append(PREDICATES[name].function(stage.rows(np.array([10])))[0])
            line(ax, np.degrees(rates), name, values, colour, sigma == UNSURE)
    ax.set(xlabel="turn rate at 4 m/s, °/s, positive to the left")


def u_turns(ax) -> None:
    angles = np.linspace(0, 220, 90)
    for sigma in (SURE, UNSURE):
        values = []
        for angle in np.radians(angles):
            stage = stage_of(arc(3.0, angle / 6, 6.0), sigma=sigma)
            values.append(PREDICATES["u_turning"].function(stage.rows(np.array([15])))[0])
        line(ax, angles, "u_turning", values, BLUE, sigma == UNSURE)
    ax.set(xlabel="turned in 6 s at 3 m/s, °")


def gears(ax) -> None:
    speed = np.concatenate(
        [np.linspace(0, -1.5, 6), np.full(10, -1.5), np.linspace(-1.5, 0, 6), np.zeros(5)]
    )
    speed = np.concatenate([speed, np.linspace(0, 5, 10), np.full(15, 5.0)])
    v = np.column_stack([speed, 0 * speed])
    t = np.arange(len(speed)) * STEP_S
    car = {"xy": np.cumsum(v, axis=0) * STEP_S, "v": v}
    for sigma in (SURE, UNSURE):
        stage = stage_of(car, sigma=sigma)
        values = PREDICATES["reversing"].function(stage.rows(np.arange(len(t))))
        line(ax, t, "reversing", values, BLUE, sigma == UNSURE)
    ax.plot(t, speed / 5, color="#999999", lw=1, label="speed / 5 m/s")
    ax.set(xlabel="time, s; a vehicle backs out and drives off", ylim=(-0.35, 1.05))


def boxed(box, begin: float, end: float) -> dict:
    t = np.arange(begin, end + 0.1, STEP_S)
    return {"xy": np.zeros((len(t), 2)), "v": 0.0, "t": t, "box": box}


CLOCK = boxed((10.0, 10.0, 30.0, 60.0), 0.0, 20.0)


def ends(ax) -> None:
    stage = stage_of(boxed((600.0, 300.0, 640.0, 400.0), 4.0, 14.0), CLOCK)
    rows = stage.rows(np.flatnonzero(stage.tracks.track == 0))
    for name, colour in (("appears", BLUE), ("disappears", RED)):
        line(ax, rows.time_s, name, PREDICATES[name].function(rows), colour, False)
    ax.set(xlabel="time, s; a is seen from 4 to 14 s of 20 s")


def border(ax) -> None:
    gaps = np.linspace(-5, 40, 91)
    values = []
    for gap in gaps:
        stage = stage_of(boxed((gap, 300.0, gap + 40, 400.0), 4.0, 14.0), CLOCK)
        rows = stage.rows(np.flatnonzero(stage.tracks.track == 0)[-1:])
        values.append(PREDICATES["disappears"].function(rows)[0])
    line(ax, gaps, "disappears", values, RED, False)
    ax.set(xlabel="from box (40 x 100 px) to the picture's border, px")


def cover(ax) -> None:
    shares = np.linspace(0, 1, 61)
    values: dict[str, list[float]] = {"disappears": [], "disappears_into": []}
    for share in shares:
        car = boxed((600.0, 250.0, 600 + 40 * share, 450.0), 0.0, 20.0)
        stage = stage_of(boxed((600.0, 300.0, 640.0, 400.0), 4.0, 14.0), car, CLOCK)
        last = np.flatnonzero(stage.tracks.track == 0)[-1:]
        other = np.flatnonzero(stage.tracks.track == 1)[:1]
        values["disappears"].append(PREDICATES["disappears"].function(stage.rows(last))[0])
        into = PREDICATES["disappears_into"].function(stage.rows(last), stage.rows(other))
        values["disappears_into"].append(into[0])
    for (name, found), colour in zip(values.items(), (RED, BLUE), strict=True):
        mirror = {"disappears": "appears", "disappears_into": "appears_from"}[name]
        line(ax, shares, name, found, colour, False, f"{name} (and {mirror})")
    ax.set(xlabel="share of a's last (first) box that b covers")


def leaving(ax) -> None:
    speeds = np.linspace(-60, 100, 81)
    car = boxed((0.0, 250.0, 150.0, 450.0), 0.0, 20.0)
    values: dict[str, list[float]] = {"disappears": [], "disappears_into": []}
    for speed in speeds:
        person = boxed((0.0, 300.0, 40.0, 400.0), 4.0, 14.0)
        shift = (14.0 - person["t"])[:, None] * np.array([speed, 0.0, speed, 0.0])
        stage = stage_of({**person, "box": np.add(person["box"], shift)}, car, CLOCK)
        last = stage.rows(np.flatnonzero(stage.tracks.track == 0)[-1:])
        other = stage.rows(np.flatnonzero(stage.tracks.track == 1)[:1])
        values["disappears"].append(PREDICATES["disappears"].function(last)[0])
        values["disappears_into"].append(PREDICATES["disappears_into"].function(last, other)[0])
    for (name, found), colour in zip(values.items(), (RED, BLUE), strict=True):
        line(ax, speeds, name, found, colour, False)
    ax.set(xlabel="outwards at the border, px/s; box of 40 x 100 px within b")


def stoops(ax) -> None:
    shares = np.linspace(0.5, 1.1, 121)
    for tall, colour in ((200.0, BLUE), (40.0, RED), (15.0, GREEN)):
        values = []
        for share in shares:
            top = 600 - tall * np.append(np.ones(9), share)
            box = np.column_stack([np.full(10, 300.0), top, np.full(10, 330.0), np.full(10, 600.0)])
            stage = stage_of({"xy": np.zeros((10, 2)), "v": 0.0, "box": box})
            values.append(PREDICATES["stooping"].function(stage.rows(np.array([9])))[0])
        line(ax, shares, "stooping", values, colour, False, f"stooping, {tall:.0f} px tall")
    ax.set(xlabel="height over standing height")


def zones(ax) -> None:
    x = np.linspace(-3, 9, 240)
    zone = {"yard": np.array([[0.0, -5.0], [6.0, -5.0], [6.0, 5.0], [0.0, 5.0]])}
    for sigma in (SURE, UNSURE):
        stage = stage_of({"xy": np.column_stack([x, 0 * x])}, sigma=sigma, zones=zone)
        values = PREDICATES["inside"].function(stage.rows(np.arange(240)), zone="yard")
        line(ax, x, "inside", values, BLUE, sigma == UNSURE)
    ax.axvspan(0, 6, color="#dddddd", zorder=-1)
    ax.set(xlabel="place, m; the zone is grey")


def lines(ax) -> None:
    t = np.arange(-4.0, 4.01, STEP_S)
    gate = {"gate": np.array([[0.0, -3.0], [0.0, 3.0]])}
    walk = {"xy": np.column_stack([1.3 * t, 0 * t]), "v": [1.3, 0.0], "t": t + 4}
    for sigma in (SURE, UNSURE):
        stage = stage_of(walk, sigma=sigma, lines=gate)
        values = PREDICATES["crosses"].function(stage.rows(np.arange(len(t))), line="gate")
        line(ax, t, "crosses", values, BLUE, sigma == UNSURE)
    ax.set(xlabel="time from the line, s, at 1.3 m/s")


def arms(ax) -> None:
    body = {
        "left_hip": (14, 90), "right_hip": (-14, 90), "left_shoulder": (17, 140),
        "right_shoulder": (-17, 140), "head_top": (0, 167), "left_ankle": (10, 5),
        "right_ankle": (-10, 5), "left_wrist": (25, 100), "right_wrist": (-25, 82),
    }  # fmt: skip
    rates = np.linspace(-1.2, 1.2, 61)
    found: dict[str, list[float]] = {"arm_moving_up": [], "arm_moving_down": []}
    for rate in rates:
        joints = np.full((7, 26, 2), np.nan)
        for name, (right, up) in body.items():
            joints[:, HALPE26.index(name)] = (300 + right, 300 - up)
        joints[:, HALPE26.index("left_wrist"), 1] -= 100 * rate * np.arange(7) * STEP_S
        stage = stage_of({"xy": np.zeros((7, 2)), "v": 0.0, "joints": joints})
        for name, values in found.items():
            values.append(PREDICATES[name].function(stage.rows(np.array([3])))[0])
    for (name, values), colour in zip(found.items(), (BLUE, RED), strict=True):
        line(ax, rates, name, values, colour, False)
    ax.set(xlabel="a wrist against its shoulder, m/s, positive up")


PANELS = (
    ground, speeds, directions, followers, looks, sides, turns, u_turns, gears, ends, border, cover,
    leaving, stoops, zones, lines, arms,
)  # fmt: skip


def main() -> None:
    figure = Figure(figsize=(13, 19.5), layout="constrained")
    axes = figure.subplots(-(-len(PANELS) // 3), 3).ravel()
    for ax in axes[len(PANELS) :]:
        ax.remove()
    for ax, draw in zip(axes[: len(PANELS)], PANELS, strict=True):
        ax.set(ylim=(-0.03, 1.05))
        draw(ax)
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8, loc="best", framealpha=0.8)
    figure.supylabel("probability")
    figure.savefig(Path(__file__).parent / "images" / "predicates.png", dpi=90)


if __name__ == "__main__":
    main()
