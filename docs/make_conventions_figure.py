"""Draw docs/images/conventions.png: world and camera axes, tilt and roll, from the code itself."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from scene4d.core.geometry import rotation_from_tilt_roll

INK, X, Y, Z = "#333333", "#c0392b", "#1e8449", "#1f5fa8"


def arrow(ax, start, end, colour, label, shift=(0.0, 0.0)) -> None:
    ax.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2})
    ax.text(end[0] + shift[0], end[1] + shift[1], label, color=colour, fontsize=11)


def side_view(ax) -> None:
    tilt, height = np.radians(25.0), 5.0
    R = rotation_from_tilt_roll(tilt, 0.0)
    centre = np.array([0.0, height])
    y_down, forward = R[1, 1:], R[2, 1:]  # rows of R are the camera's axes in the world (Y, Z)
    ax.axhline(0, color=INK, lw=1.5)
    ax.plot([0, 0], [0, height], color=INK, ls=":", lw=1.2)
    ax.plot([0, 6.5], [height, height], color=INK, ls="--", lw=1)
    ax.text(6.6, height, "horizon", va="center", fontsize=10, color=INK)
    reach = height / -forward[1]
    ax.plot([0, forward[0] * reach], [height, 0], color=INK, lw=0.8)
    arrow(ax, centre, centre + 3 * forward, Z, "z (optical axis)", (-1.6, -0.75))
    arrow(ax, centre, centre + 1.5 * y_down, Y, "y", (-0.45, -0.3))
    arrow(ax, (0, 0), (2.2, 0), Y, "Y", (0.0, -0.6))
    arrow(ax, (0, 0), (0, 1.8), Z, "Z", (-0.5, -0.2))
    angle = np.linspace(0, -tilt, 30)
    ax.plot(4 * np.cos(angle), height + 4 * np.sin(angle), color=INK, lw=1)
    ax.text(4.1, height - 0.95, "tilt", fontsize=11, color=INK)
    ax.text(-0.75, height / 2, "height", rotation=90, ha="right", va="center", color=INK)
    ax.plot(*centre, "s", ms=9, color=INK)
    person = forward[0] * reach
    ax.plot([person, person], [0, 1.7], color=X, lw=4, solid_capstyle="round")
    ax.text(person + 0.25, 0.85, "1.70 m", color=X, va="center")
    ax.set(xlim=(-1.8, 12.6), ylim=(-1.0, 7.0), title="from the side")


def image_view(ax) -> None:
    roll, tilt, focal = np.radians(8.0), np.radians(20.0), 600.0
    up = rotation_from_tilt_roll(tilt, roll)[:, 2]
    ax.add_patch(Rectangle((-320, -240), 640, 480, fill=False, ec=INK))
    u = np.array([-320.0, 320.0])
    ax.plot(u, -(up[0] * u + up[2] * focal) / up[1], color=INK, ls="--")
    ax.text(-310, -285, "horizon", fontsize=10, color=INK)
    arrow(ax, (0, 0), (110, 0), X, "u, x", (8, 5))
    arrow(ax, (0, 0), (0, 110), Y, "v, y", (8, 8))
    for foot in ((-200.0, 150.0), (60.0, 210.0), (230.0, 120.0)):
        ray = np.array([foot[0] / focal, foot[1] / focal, 1.0])
        head = ray + 0.28 * -(up @ ray) * up
        top = focal * head[:2] / head[2]
        ax.plot([foot[0], top[0]], [foot[1], top[1]], color=X, lw=3)
    arrow(ax, (0, 0), (130 * up[0], 130 * up[1]), Z, "up", (8, 0))
    ax.plot([0, 0], [0, -150], color=INK, lw=0.8, ls=":")
    ax.text(-75, -100, "roll > 0", fontsize=10, color=INK)
    ax.set(xlim=(-360, 360), ylim=(270, -310), title="in the picture")


def main() -> None:
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.35, 1))
    side_view(left)
    image_view(right)
    for ax in (left, right):
        ax.set_aspect("equal")
        ax.axis("off")
    figure.savefig(Path(__file__).parent / "images" / "conventions.png", dpi=110)


if __name__ == "__main__":
    main()
