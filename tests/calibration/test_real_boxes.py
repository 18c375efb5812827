"""Boxes of real recordings, with what is known of their cameras.

The truth is the recordings' own calibration; error is measured as METHOD defines it, with code
written here: 12 ground points spread over where people walk, rigid alignment, no scale.
"""

import warnings
from pathlib import Path

import numpy as np
import pytest
from scenes import correspondence_error, solve_points

from scene4d.calibration import person_segments
from scene4d.core.camera import Camera
from scene4d.core.orientation import Orientation
from scene4d.core.people import Detections
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import read_camera

pytestmark = pytest.mark.shared_data


def boxes(path: Path, size: tuple[int, int]) -> Detections:
    """Annotations without the rows that hold no box; the reader says how many it dropped."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return read_annotations(path, image_size=size, drop_invalid=True, fps=10.0)


def spread_points(xy: np.ndarray, n: int = 12) -> np.ndarray:
    """Farthest-point sampling from the point that is nearest to the middle."""
    chosen = [int(np.argmin(np.hypot(*(xy - np.median(xy, axis=0)).T)))]
    distance = np.full(len(xy), np.inf)
    while len(chosen) < n:
        distance = np.minimum(distance, np.hypot(*(xy - xy[chosen[-1]]).T))
        chosen.append(int(distance.argmax()))
    return xy[chosen]


def error_m(truth: Camera, found: Camera, xy_m: np.ndarray) -> float:
    """Mean distance; both cameras have the same lens, so undistorted pixels will do."""
    np.testing.assert_allclose(found.K, truth.K, rtol=1e-6)
    return float(correspondence_error(truth, found, spread_points(xy_m)).mean())


def walked(camera: Camera, foot_uv: np.ndarray) -> np.ndarray:
    """Ground under the feet, within 60 m of the camera."""
    xy, seen = camera.locate(foot_uv)
    return xy[seen & (np.hypot(*(xy - camera.centre_m[:2]).T) < 60)]


@pytest.mark.parametrize(
    ("name", "error", "height"), [("PETS2009-S2L1.xml", 0.35, 0.04), ("frcnn_det.txt", 0.5, 0.12)]
)
def test_pets_boxes_with_the_true_lens(shared_data, name, error, height):
    """Measured: 0.25 m with hand-drawn boxes, 0.27 m with a detector's (which are loose). Their
    drift must not pass for a second level of the ground (it did, 1.08 m).
    """
    folder, size = shared_data / "pets2009", (768, 576)
    camera = read_camera(folder / "View_001.xml")
    drawn = boxes(folder / "PETS2009-S2L1.xml", size)
    x1, _, x2, y2 = drawn.box_xyxy.T
    xy = walked(camera, np.column_stack([(x1 + x2) / 2, y2]))
    people = person_segments(boxes(folder / name, size))
    assert people.from_box.all()
    found = solve_points(people, image_size=size, lens=camera.lens, systematics=True)
    assert found
    assert error_m(camera, found.camera, xy) < error
    assert found.camera.height_m == pytest.approx(camera.height_m, rel=height)
    assert found.camera.tilt_rad == pytest.approx(camera.tilt_rad, abs=np.radians(1.2))
    assert found.camera.roll_rad == pytest.approx(camera.roll_rad, abs=np.radians(2.0))
    assert not found.ground_regions
    # Its own prediction is honest about the ground.
    assert error_m(camera, found.camera, xy) < 2 * found.ground_error_m["median"]
    alone = solve_points(people, image_size=size)
    assert alone.reason.startswith("boxes alone do not determine the focal length")


@pytest.mark.parametrize("consensus", ["exact", "ransac"])
def test_towncentre_by_the_papers_method(shared_data, consensus):
    """The paper's figure, with 1000 frames and a network, is 1.18 m; here it is told all else."""
    folder, size = shared_data / "towncentre", (1920, 1080)
    camera = read_camera(folder / "TownCentre-calibration.ci")
    truth = np.genfromtxt(folder / "TownCentreGTHalfRes.csv", delimiter=",", skip_header=1)
    truth = truth[np.isfinite(truth).all(axis=1)]
    _, _, x, y, w, h = truth[:, :6].T
    xy = walked(camera, 2 * np.column_stack([x + w / 2, y + h]))
    people = person_segments(boxes(folder / "tracker_boxes.txt", size))
    error = {}
    for height in (1.5748, 1.70, 1.8288):
        found = solve_points(
            people,
            image_size=size,
            method="paper",
            orientation=Orientation(camera.focal_px, camera.tilt_rad, camera.roll_rad),
            lens=camera.lens,
            person_height_m=height,
            consensus=consensus,
        )
        assert found
        error[height] = error_m(camera, found.camera, xy)
    assert error[1.70] <= 0.3
    # METHOD section 2 measured 0.91, 0.15 and 0.61 m.
    assert 0.6 < error[1.5748] < 1.2
    assert 0.3 < error[1.8288] < 0.9
