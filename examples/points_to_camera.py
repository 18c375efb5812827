"""From the feet and heads of people to a camera, without any picture.

    python examples/points_to_camera.py

Whoever has a detector needs only ``solve_camera``: (n, 2) arrays of undistorted pixels.
"""

import numpy as np

import scene4d

TRUTH = scene4d.Camera.from_pose(
    image_size=(1280, 720), focal_px=900.0, tilt_rad=np.radians(22.0), roll_rad=0.03, height_m=4.5
)


def walkers(count: int, steps: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Feet, heads and track numbers of people who cross the scene, seen with some noise."""
    rng = np.random.default_rng(seed)
    start = rng.uniform([-5, 7], [5, 20], (count, 1, 2))
    heading = rng.uniform(-np.pi, np.pi, (count, 1))
    path = np.stack([np.cos(heading), np.sin(heading)], axis=-1) * np.linspace(0, 3, steps)[:, None]
    where = (start + path).reshape(-1, 2)
    heights = np.repeat(rng.normal(1.70, 0.09, count), steps)
    feet, _ = TRUTH.project(np.column_stack([where, np.full(len(where), 0.04)]))
    heads, _ = TRUTH.project(np.column_stack([where, heights]))
    inside = ((feet > 0) & (heads > 0) & (feet < (1280, 720))).all(axis=1)
    noisy = heads + rng.normal(0, 2.0, heads.shape)
    return feet[inside], noisy[inside], np.repeat(np.arange(count), steps)[inside]


def main() -> None:
    feet, heads, track = walkers(count=25, steps=8)
    found = scene4d.solve_camera(feet, heads, image_size=TRUTH.image_size, track=track)
    if not found:
        raise SystemExit(f"no camera: {found.reason}")
    camera, sigma = found.camera, found.sigma
    print(f"{len(feet)} sightings of {len(np.unique(track))} people, {found.inliers} agree")
    rows = [
        ("focal length", "px", camera.focal_px, sigma["focal_px"], TRUTH.focal_px),
        ("tilt", "deg", np.degrees(camera.tilt_rad), sigma["tilt_deg"], 22.0),
        ("height", "m", camera.height_m, sigma["height_m"], TRUTH.height_m),
    ]
    for name, unit, value, spread, truth in rows:
        print(f"{name:12s} {value:7.2f} ± {spread:.2f} {unit} (true {truth:.2f})")
    pixel = np.array([[640.0, 500.0]])
    xy_m, _ = camera.locate(pixel)
    error_m = found.ground_sigma_m(pixel, from_camera=True)[0]
    print(f"pixel (640, 500) is {np.hypot(*xy_m[0]):.1f} ± {error_m:.1f} m away")


if __name__ == "__main__":
    main()
