"""The VIRAT experiment on files in the official layout, written from a camera that is known.

Nothing of VIRAT itself is here: a homography, an annotation and a video are made on the spot, so
every position and distance has a truth that no code of the package computed from those files.
"""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.distance import cdist

from scene4d.calibration import CalibrateOptions, person_segments, solve_segments
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.people import Detections
from scene4d.evaluation import PUBLISHED
from scene4d.evaluation.datasets._virat import spread_frames, virat
from strategies import build_camera, build_lens

SIZE = (1920, 1080)
CAMERA = build_camera(build_lens(SIZE, 45.0), 22.0, 1.0, 7.0, heading_deg=30.0, xy_m=(5.0, -3.0))
CLIP = "VIRAT_S_000101_00_000000_000100"
OBJECTS = ".viratdata.objects.txt"
PERSON, CAR, VEHICLE, OBJECT = 1, 2, 3, 4
CLIP_FRAMES = 60
# Where each walks or stands, in whole pixels of the feet, from the first frame to the last.
WALKS = [
    ((500, 420), (1300, 560)), ((900, 700), (1100, 400)), ((1400, 520), (700, 640)),
    ((700, 500), (620, 760)), ((1000, 460), (1250, 700)), ((820, 560), (980, 540)),
]  # fmt: skip
PARKED, DRIVES = (1000, 640), ((300, 800), (1700, 620))


def ground_of(uv):
    """True metres of pixels: P without its third column, inverted by hand."""
    to_pixels = CAMERA.P[:, [0, 1, 3]]
    x = np.linalg.solve(to_pixels, np.column_stack([uv, np.ones(len(uv))]).T)
    return (x[:2] / x[2]).T


def head_row(foot, height_m):
    xy = ground_of(np.array([foot], float))[0]
    _, v, w = CAMERA.P @ [*xy, height_m, 1.0]
    return v / w


def path(start, end):
    share = np.linspace(0, 1, CLIP_FRAMES)[:, None]
    return np.round(np.array(start) + share * (np.array(end) - np.array(start))).astype(int)


def row(track, frame, foot, width, height, kind):
    """One line: the bottom centre of the box is exactly the pixel ``foot``."""
    u, v = (int(x) for x in foot)
    values = (track, CLIP_FRAMES, frame, u - width // 2, v - height, width, height, kind)
    return " ".join(map(str, values))


def people_rows():
    rows = []
    for track, (start, end) in enumerate(WALKS):
        for frame, foot in enumerate(path(start, end)):
            tall = round(foot[1] - head_row(foot, 1.70))
            rows.append(row(track, frame, foot, 2 * round(tall / 6), tall, PERSON))
    return rows


def vehicle_rows():
    drive = path(*DRIVES)
    return [row(20, f, PARKED, 160, 90, CAR) for f in range(0, CLIP_FRAMES, 2)] + [
        row(21, f, foot, 200, 120, VEHICLE) for f, foot in enumerate(drive) if f >= 20
    ]


def homography_text(camera=CAMERA):
    H = np.linalg.inv(camera.P[:, [0, 1, 3]])
    return "".join(",".join(f"{x:.12g}" for x in line) + "\n" for line in H / np.linalg.norm(H))


def write_release(folder, rows, clip=CLIP, scene="0001", camera=CAMERA):
    """The folders of the release; returns the root."""
    for name in ("annotations", "homographies", "videos_original"):
        (folder / name).mkdir(exist_ok=True)
    text = "\n".join(rows) + "\n"
    (folder / "annotations" / f"{clip}{OBJECTS}").write_text(text)
    (folder / "annotations" / f"._{clip}{OBJECTS}").touch()  # macOS leaves such beside files
    (folder / "annotations" / f"{clip}.viratdata.events.txt").write_text("0 5 9 1 9 1 2 3 4 5\n")
    (folder / "homographies" / f"VIRAT_{scene}_homography_img2world.txt").write_text(
        homography_text(camera)
    )
    (folder / "homographies" / f"VIRAT_{scene}_homography_img2world.png").touch()
    (folder / "homographies" / "README_homography.txt").write_text("read me\n")
    return folder


@pytest.fixture
def release(tmp_path):
    others = [row(30, 3, (600, 600), 20, 20, OBJECT)]
    return write_release(tmp_path, people_rows() + vehicle_rows() + others)


def given(camera: Camera) -> Calibration:
    return Calibration(
        status="ok", method="given", image_size=SIZE, person_height_m=1.70, camera=camera
    )


def true_pairs():
    """Distances of all persons and vehicles that share a frame."""
    walks = [ground_of(path(*walk)) for walk in WALKS]
    parked, drive = ground_of(np.array([PARKED], float))[0], ground_of(path(*DRIVES))
    out = []
    for frame in range(CLIP_FRAMES):
        vehicles = [parked] if frame % 2 == 0 else []
        vehicles += [drive[frame]] if frame >= 20 else []
        out += [np.hypot(*(walk[frame] - xy)) for walk in walks for xy in vehicles]
    return np.array(out)


def test_positions_are_those_of_the_camera(release):
    scene = virat(release, image_size=SIZE)
    assert (scene.name, scene.clip, scene.video) == ("0001", CLIP, None)
    assert scene.annotations == release / "annotations" / f"{CLIP}{OBJECTS}"
    assert scene.reference.name == "VIRAT 0001"
    feet = np.concatenate([path(*walk) for walk in WALKS]).astype(float)
    np.testing.assert_array_equal(scene.reference.feet_uv, feet)
    xy, seen = scene.reference.locate(feet)
    assert seen.all()
    np.testing.assert_allclose(xy, ground_of(feet), atol=1e-6)
    assert len(scene.people) == len(feet)
    assert set(scene.people.class_name) == {"person"}
    assert scene.people.track.max() == len(WALKS) - 1
    assert np.isnan(scene.people.time_s).all()
    assert "rough estimates" in scene.notes[0]
    assert len(scene.notes) == 1


def test_the_camera_behind_the_homography(release):
    found = virat(release, image_size=SIZE).reference.camera
    assert found.focal_px == pytest.approx(CAMERA.focal_px, rel=1e-5)
    assert found.tilt_rad == pytest.approx(CAMERA.tilt_rad, abs=1e-6)
    assert found.roll_rad == pytest.approx(CAMERA.roll_rad, abs=1e-6)
    assert found.height_m == pytest.approx(7.0, rel=1e-5)


def test_the_papers_method_on_the_boxes(release):
    scene = virat(release, image_size=SIZE)
    segments = person_segments(scene.people)
    true = Orientation(CAMERA.focal_px, CAMERA.tilt_rad, CAMERA.roll_rad)

    def error_m(orientation, person_height_m):
        options = CalibrateOptions(
            person_height_m=person_height_m, orientation=orientation, method="paper"
        )
        found = solve_segments(segments, SIZE, options)
        return scene.reference.score(found.camera).mean_m, found

    good, found = error_m(true, 1.70)
    assert good < 0.02  # boxes are whole pixels
    assert found.camera.height_m == pytest.approx(7.0, rel=0.002)
    assert scene.reference.near(found).auc > 0.99
    assert error_m(replace(true, focal_px=0.7 * true.focal_px), 1.70)[0] > 0.1
    assert error_m(true, 1.8288)[0] > 0.15


def test_people_meet_the_vehicles_of_their_own_frame(release):
    reference = virat(release, image_size=SIZE).reference
    assert reference.meetings is not None
    truth = np.sort(true_pairs())
    np.testing.assert_allclose(np.sort(reference.judged[1]), truth, atol=1e-5)
    assert 0 < (truth < 4).sum() < len(truth)
    pairs = reference.near(given(CAMERA))
    np.testing.assert_array_equal(pairs.true_m, reference.judged[1])
    np.testing.assert_allclose(pairs.estimated_m, pairs.true_m, atol=1e-5)
    np.testing.assert_array_equal(pairs.sigma_m, 0)
    # Twice as high, everything is twice as far apart, pair by pair.
    double = replace(CAMERA, t=-CAMERA.R @ (CAMERA.centre_m * [1, 1, 2]))
    np.testing.assert_allclose(reference.near(given(double)).estimated_m, 2 * pairs.true_m)


def test_the_spread_of_a_distance_is_that_of_near_pairs(release):
    """With a covariance, against the plain reference that pairs everybody with everything."""
    reference = virat(release, image_size=SIZE).reference
    found = replace(given(CAMERA), covariance=np.diag([1e-3, 1e-4, 1e-4, 1e-3, 0.0]))
    pairs = reference.near(found)
    assert (pairs.sigma_m > 0).all()
    by_height = replace(given(CAMERA), covariance=np.diag([0.0, 0.0, 0.0, 1e-4, 0.0]))
    pairs = reference.near(by_height)  # a height off by 1 % scales every distance by 1 %
    np.testing.assert_allclose(pairs.sigma_m, 0.01 * pairs.true_m, rtol=1e-6)


def test_another_image_size_is_refused(release):
    reference = virat(release, image_size=SIZE).reference
    small = build_camera(build_lens((1280, 720), 45.0))
    with pytest.raises(InputError, match="1280x720"):
        reference.near(replace(given(small), image_size=(1280, 720)))


def test_a_parked_vehicle_is_one_place(release):
    places = virat(release, image_size=SIZE).reference.vehicle_uv
    parked = (places == PARKED).all(axis=1)
    assert parked.sum() == 1
    assert 5 < len(places) < 20  # the other drives some 10 m in 40 frames


def test_a_vehicle_that_creeps_is_one_place_per_metre(tmp_path):
    creeps = path((1000, 600), (1059, 600))
    rows = people_rows() + [row(20, f, foot, 160, 90, CAR) for f, foot in enumerate(creeps)]
    places = virat(write_release(tmp_path, rows), image_size=SIZE).reference.vehicle_uv
    ends = ground_of(creeps[[0, -1]])
    # A straight line meets about one square per metre along each axis.
    assert len(places) <= np.abs(ends[1] - ends[0]).sum() + 2 < 5
    assert set(map(tuple, places)) <= set(map(tuple, creeps.astype(float)))


def test_without_vehicles_the_points_stand_in(tmp_path):
    scene = virat(write_release(tmp_path, people_rows()), image_size=SIZE)
    assert scene.reference.meetings is None
    assert scene.reference.vehicle_uv is None
    assert "correspondence points stand in" in scene.notes[1]
    pairs = scene.reference.near(given(CAMERA))
    itself = cdist(scene.people.box_foot_uv, scene.reference.points_uv) == 0
    assert len(pairs.true_m) == 12 * len(scene.people) - itself.sum()


@pytest.mark.parametrize(
    ("people", "vehicle", "note"),
    [
        # They are never there at the same time; all are far; the one and only pair is near.
        (6, row(20, CLIP_FRAMES + 5, PARKED, 160, 90, CAR), "Of 0 pairs .* 0 are near,"),
        (6, row(20, 0, (300, 1000), 160, 90, CAR), "Of 6 pairs .* 0 are near,"),
        (1, row(20, 0, WALKS[0][0], 160, 90, CAR), "Of 1 pairs .* 1 are near,"),
    ],
)
def test_where_no_roc_is_to_be_had_from_one_frame(tmp_path, people, vehicle, note):
    rows = [*people_rows()[: people * CLIP_FRAMES], vehicle]
    scene = virat(write_release(tmp_path, rows), image_size=SIZE)
    assert scene.reference.meetings is None
    assert len(scene.reference.vehicle_uv) == 1
    assert re.match(note, scene.notes[1])
    assert len(scene.reference.near(given(CAMERA)).true_m) == people * CLIP_FRAMES


def test_what_is_below_the_picture_or_above_the_horizon_meets_nobody(tmp_path):
    level = build_camera(build_lens(SIZE, 45.0), 8.0, 0.0, 7.0)  # sees its horizon in row 213
    below, above = row(40, 0, (960, 1100), 200, 300, PERSON), row(41, 0, (960, 200), 20, 40, CAR)
    rows = people_rows() + vehicle_rows()
    before = virat(write_release(tmp_path, rows, camera=level), image_size=SIZE).reference
    rows += [below, above]
    after = virat(write_release(tmp_path, rows, camera=level), image_size=SIZE).reference
    assert level.locate(np.array([[960.0, 200], [960, 230]]))[1].tolist() == [False, True]
    np.testing.assert_array_equal(after.judged[1], before.judged[1])
    np.testing.assert_array_equal(after.vehicle_uv, before.vehicle_uv)
    assert len(after.feet_uv) == len(before.feet_uv) + 1
    assert len(after.walked_uv) == len(before.walked_uv)


def test_long_clips_are_thinned_to_frames_as_many_as_the_papers():
    frame = np.repeat(np.arange(0, 3000, 3), 2)
    many = Detections.from_boxes(SIZE, frame, np.tile([1.0, 2, 3, 4], (len(frame), 1)))
    few = spread_frames(many)
    kept = np.unique(few.frame)
    assert len(kept) == PUBLISHED["virat"].frames
    assert (kept[0], kept[-1]) == (0, 2997)
    assert len(few) == 2 * PUBLISHED["virat"].frames
    assert set(np.diff(kept)) == {6, 9}  # every second, and once every third
    assert spread_frames(few) is few


def write_video(release, size=(160, 96), fps=20):
    video = release / "videos_original" / f"{CLIP}.avi"
    out = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"MJPG"), fps, size)
    for level in range(3):
        out.write(np.full((size[1], size[0], 3), 40 * level, np.uint8))
    out.release()
    return video


def test_the_video_tells_size_and_clock(tmp_path):
    rows = [row(0, f, (20 + 5 * f, 60 + f), 6, 20, PERSON) for f in range(20)]
    release = write_release(tmp_path, rows)
    video = write_video(release)
    scene = virat(release)
    assert scene.video == video
    assert scene.reference.image_size == (160, 96)
    np.testing.assert_allclose(scene.people.time_s, np.arange(20) / 20)
    assert virat(release, image_size=(160, 96)).video == video
    with pytest.raises(InputError, match=r"\.avi: is 160x96, but image_size says 1920x1080"):
        virat(release, image_size=SIZE)


def test_without_a_video_the_size_must_be_told(release):
    with pytest.raises(InputError, match=r"objects\.txt: its video is not.*image_size.*1280x720"):
        virat(release)


def test_clips_are_chosen_by_name_or_in_order(release):
    second = "VIRAT_S_010002_01_000100_000200"
    write_release(release, people_rows()[:60], clip=second, scene="0100")
    assert virat(release, image_size=SIZE).clip == CLIP
    for wanted in (second, second + OBJECTS):
        scene = virat(release, clip=wanted, image_size=SIZE)
        assert (scene.clip, scene.name, len(scene.people)) == (second, "0100", 60)
    with pytest.raises(InputError, match=f"holds no clip 'x'; it has {CLIP}, {second}"):
        virat(release, clip="x", image_size=SIZE)
    for number in range(10):
        write_release(release, people_rows()[:1], clip=f"VIRAT_S_02000{number}", scene="0200")
    with pytest.raises(InputError, match="VIRAT_S_020005 and 4 more"):
        virat(release, clip="x", image_size=SIZE)


@pytest.mark.parametrize("flat", [False, True])
def test_a_flat_folder_will_do(tmp_path, flat):
    release = write_release(tmp_path, people_rows(), clip="VIRAT_S_000101")
    if flat:
        for file in [*release.rglob("*.txt")]:
            file.rename(release / file.name)
    assert virat(str(release), image_size=SIZE).clip == "VIRAT_S_000101"


def test_impossible_boxes_are_left_out_and_told(tmp_path):
    rows = [*people_rows(), row(50, 0, (500, 500), 0, 40, PERSON)]
    release = write_release(tmp_path, rows)
    with pytest.warns(UserWarning, match=r"objects\.txt: left out 1 of 361 boxes"):
        scene = virat(release, image_size=SIZE)
    assert len(scene.people) == 360


def homographies(release):
    return release / "homographies"


def spoil(text):
    def change(release):
        (homographies(release) / "VIRAT_0001_homography_img2world.txt").write_text(text)

    return change


def of_another_scene(release):
    (homographies(release) / "VIRAT_0001_homography_img2world.txt").rename(
        homographies(release) / "VIRAT_0002_homography_img2world.txt"
    )


def no_homography(release):
    (homographies(release) / "VIRAT_0001_homography_img2world.txt").unlink()


def second_homography(release):
    (release / "more").mkdir()
    (release / "more" / "0001_homography_img2world.txt").write_text(homography_text())


def second_annotation(release):
    text = (release / "annotations" / f"{CLIP}{OBJECTS}").read_text()
    (release / f"{CLIP}{OBJECTS}").write_text(text)


def second_video(release):
    for suffix in (".avi", ".MP4"):
        (release / "videos_original" / f"{CLIP}{suffix}").touch()


def no_annotation(release):
    (release / "annotations" / f"{CLIP}{OBJECTS}").unlink()


def odd_name(release):
    (release / "annotations" / f"{CLIP}{OBJECTS}").rename(
        release / "annotations" / f"VIRAT_S_12{OBJECTS}"
    )


def annotation(text):
    def change(release):
        (release / "annotations" / f"{CLIP}{OBJECTS}").write_text(text)

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (spoil("1,2,3\n4,5,6\n7,8\n"), r"img2world\.txt: line 3: expected the 9 numbers"),
        (spoil("1,2,3\n4,nan,6\n7,8,9\n"), r"img2world\.txt: line 2: expected a finite number"),
        (spoil("1,2,3\n2,4,6\n7,8,9\n"), r"img2world\.txt: homography: .*not invertible"),
        (of_another_scene, "homography of scene 0001 .* is missing; .*found those of scenes: 0002"),
        (no_homography, "homography of scene 0001 .* is missing; .*of scenes: none"),
        (second_homography, "more than one file for scene 0001: .* and .*; leave one"),
        (second_annotation, f"more than one file for clip {CLIP}: .* and "),
        (second_video, "more than one file for the video of clip"),
        (no_annotation, r"holds no annotation \*\.viratdata\.objects\.txt"),
        (odd_name, "does not say which scene"),
        (annotation(""), r"objects\.txt: the file is empty"),
        (annotation("0 3 0 100 200 30 60\n"), r"objects\.txt: line 1: expected 8 columns"),
        (annotation("0 3 0 100 200 30 60 2\n"), f"holds no persons; choose another .*{CLIP}"),
        (annotation("0 3 0 100 2000 30 60 1\n"), r"objects\.txt: 1 of 1 boxes are impossible"),
    ],
)
def test_bad_folders(release, change, message):
    change(release)
    with pytest.raises(InputError, match=message):
        virat(release, image_size=SIZE)


def test_not_a_folder(tmp_path):
    with pytest.raises(InputError, match="is no folder"):
        virat(tmp_path / "none")
