"""Spoilt files end in a reading or in a short InputError, never in another exception."""

import json
import random
import time
import tracemalloc

import pytest

from scene4d.core.errors import InputError
from scene4d.formats.activities import read_activities
from scene4d.formats.annotations import annotation_formats, read_annotations
from scene4d.formats.cameras import camera_formats, read_camera
from scene4d.formats.homographies import read_ground_map, read_reference
from scene4d.formats.points import read_points

K = "600, 0, 319.5, 0, 600, 239.5, 0, 0, 1"
KITTI = "600 0 319.5 0 0 600 239.5 0 0 0 1 0"
UPRIGHT = [1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 5, 0, 0, 0, 1]  # looks along -Y here, 5 m high
CAMERAS = {
    "opencv-yaml": "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n"
    f"camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ {K} ]\n"
    "rvec: [1.5, 0.1, 0]\ntvec: [0, 1, 2]\n",
    "opencv-xml": '<?xml version="1.0" encoding="utf-8"?>\n<opencv_storage>'
    "<image_width>640</image_width><image_height>480</image_height>"
    '<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>'
    f"<data>{K.replace(',', ' ')}</data></camera_matrix></opencv_storage>",
    "krtd": "600 0 319.5\n0 600 239.5\n0 0 1\n1 0 0\n0 0 -1\n0 1 0\n0 5 0\n0 0\n",
    "ros": f"image_width: 640\nimage_height: 480\ncamera_matrix: {{data: [{K}]}}\n"
    "distortion_model: plumb_bob\ndistortion_coefficients: {data: [0, 0, 0, 0, 0]}\n",
    "deepstream": "projectionMatrix_3x4: [600, 0, 0, 0, 0, 0, -600, 600, 0, 1, 0, 0]\n"
    "modelInfo: {height: 170}\n",
    "matrix": "600 0 319.5 0\n0 600 239.5 0\n0 0 1 0\n",
    "tsai": '<?xml version="1.0" encoding="utf-8"?><C><Geometry width="768" height="576" '
    'dpx="5e-3" dpy="5e-3"/><Intrinsic focal="5.5" kappa1="5e-3" cx="380" cy="280" sx="1.0"/>'
    '<Extrinsic tx="0" ty="0" tz="1" rx="2" ry="0" rz="0"/></C>',
    "towncentre": "FocalLengthX = 600\nFocalLengthY = 600\nSkew = 0\nPrincipalPointX = 319.5\n"
    "PrincipalPointY = 239.5\nRotationX = 0.7\nRotationY = 0\nRotationZ = 0\nRotationW = 0.7\n"
    "TranslationX = 0\nTranslationY = 1\nTranslationZ = 2\nDistortionK1 = 0\nDistortionK2 = 0\n"
    "DistortionP1 = 0\nDistortionP2 = 0\n",
    "kitti": f"P2: {KITTI}\nS_rect_02: 640 480\n",
    "openlabel": json.dumps(
        {
            "openlabel": {
                "coordinate_systems": {
                    "c": {"parent": "p", "pose_wrt_parent": {"matrix4x4": UPRIGHT}},
                    "p": {"pose_wrt_parent": {"quaternion": [0, 0, 1, 0], "translation": [0] * 3}},
                },
                "streams": {
                    "c": {
                        "stream_properties": {
                            "intrinsics_pinhole": {
                                "camera_matrix": [float(x) for x in KITTI.split()],
                                "width_px": 640,
                                "height_px": 480,
                            }
                        }
                    }
                },
            }
        }
    ),
    "is-msgs": json.dumps(
        {
            "resolution": {"width": 640, "height": 480},
            "intrinsic": {
                "shape": {"dims": [{"size": 3}, {"size": 3}]},
                "doubles": [600, 0, 319.5, 0, 600, 239.5, 0, 0, 1],
            },
            "extrinsic": [
                {
                    "tf": {
                        "shape": {"dims": [{"size": 4}, {"size": 4}]},
                        "doubles": [1, 0, 0, 0, 0, 0, -1, 5, 0, 1, 0, 0, 0, 0, 0, 1],
                    }
                }
            ],
        }
    ),
    "json": json.dumps(
        {
            "schema": "scene4d/camera/1",
            "image_size": [640, 480],
            "K": [[600, 0, 319.5], [0, 600, 239.5], [0, 0, 1]],
            "distortion": [0, 0, 0, 0, 0],
            "R": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
            "t": [0, 5, 0],
        }
    ),
}
COLMAP = {
    "cameras.txt": "1 OPENCV 640 480 600 600 320 240 0.1 0 0 0\n",
    "rigs.txt": "1 2 CAMERA 2 CAMERA 1 1 1 0 0 0 0 0 0\n",
    "frames.txt": "1 1 0.7 -0.7 0 0 0 1 2 1 CAMERA 1 1\n",
    "images.txt": "1 0.7 -0.7 0 0 0 1 2 1 a.jpg\n\n",
}
ANNOTATIONS = {
    "mot": "1,-1,10,20,30,60,0.9\n2,-1,10,20,30,60,0.9\n",
    "pets": '<?xml version="1.0" encoding="utf-8"?><d><frame number="4"><objectlist>'
    '<object id="9"><box h="40" w="20" xc="100" yc="200"/></object></objectlist></frame></d>',
    "kpf": "- {'geom': {'g0': '10 20 30 60', 'id1': 16, 'ts0': 1167}}\n",
    "virat": "0 3 0 100 200 30 60 1\n1 900 0 800 500 120 70 2\n",
    "kitti": "0 2 Car 0 0 -2.5 106.1 166.5 204.4 323.8 1.7 0.7 0.7 6.3 1.6 8.8 -1.9\n",
    "towncentre-top": "3,0,1,1,900,200,930,240,880,200,960,450.5\n",
    "towncentre-csv": "0,1,10,20,30,40\n",
    "coco": '{"images":[{"id":1,"file_name":"f_2.jpg"}],"categories":'
    '[{"id":1,"name":"person","keypoints":["nose"]}],"annotations":[{"image_id":1,'
    '"category_id":1,"bbox":[10,20,30,60],"keypoints":[1,2,2]}]}',
}
TYPES = "- {types: {id1: 16, cset3: {person: 0.5, car: 0.25}}}\n"
ACTIVITIES = (
    "- {'act': {'act2': {'person_enters_vehicle': 1.0}, 'actors': [{'id1': 6}], 'id2': 2, "
    "'timespan': [{'tsr0': [3284, 3312]}]}}\n"
)
HOMOGRAPHIES = {
    "text": "0.01 0.002 -5\n0.001 -0.03 20\n0.0001 0.002 1\n",
    "json": '{"H": [[0.01, 0.002, -5], [0.001, -0.03, 20], [0.0001, 0.002, 1]]}',
}
TOKENS = [
    "", "-", "nan", "inf", "1e400", "1e308", "1e-308", "-1e200", "0", "²", "null", "[", "]", "{}",
    ",", "\n", "true", "'", "1.2.3", "9" * 400, "9" * 5000, "&a [", "*a", "<<: ", '"', "\x1b[31m",
    "utf-32", "idna", "hex", "\x00", "[[[[", "x" * 3000, "10000000000", "é", ": ", "3000000000",
]  # fmt: skip


def spoilt(text, rng):
    """Up to three tokens instead of some characters, of a whole word, or of a number."""
    for _ in range(rng.randint(1, 3)):
        start = rng.randrange(len(text) + 1)
        end = start + rng.randint(0, 4)
        if rng.random() < 0.6:  # a whole word
            while start and text[start - 1].isalnum():
                start -= 1
            while end < len(text) and (text[end].isalnum() or text[end] in ".-"):
                end += 1
        text = text[:start] + rng.choice(TOKENS) + text[end:]
    return text


def check(read, path, text, seed, rounds=300):
    """The unspoilt text is good; the spoilt ones end well."""
    path.write_text(text, encoding="utf-8")
    read(path)
    rng = random.Random(f"{seed} {text}")
    for _ in range(rounds):
        path.write_text(spoilt(text, rng), encoding="utf-8")
        try:
            read(path)
        except InputError as error:
            message = str(error)
            assert str(path.parent) in message
            assert len(message.replace(str(path), "")) < 500
            assert "\x1b" not in message


@pytest.mark.filterwarnings("ignore:.*either way")
@pytest.mark.parametrize("name", CAMERAS)
def test_cameras(tmp_path, name):
    check(
        lambda path: read_camera(path, format=name, image_size=(640, 480)),
        tmp_path / "camera",
        CAMERAS[name],
        name,
    )


@pytest.mark.parametrize("name", COLMAP)
def test_colmap(tmp_path, name):
    for file, text in COLMAP.items():
        (tmp_path / file).write_text(text)
    if name == "images.txt":
        (tmp_path / "frames.txt").unlink()
    check(lambda _: read_camera(tmp_path), tmp_path / name, COLMAP[name], name)


@pytest.mark.filterwarnings("ignore:.*left out")
@pytest.mark.parametrize("drop", [False, True])
@pytest.mark.parametrize("name", ANNOTATIONS)
def test_annotations(tmp_path, name, drop):
    path = tmp_path / "clip.geom.yml"
    path.with_name("clip.types.yml").write_text(TYPES)
    check(
        lambda path: read_annotations(
            path, format=name, image_size=(1920, 1080), drop_invalid=drop
        ),
        path,
        ANNOTATIONS[name],
        name,
        150,
    )


def test_classes_of_kpf(tmp_path):
    geom = tmp_path / "clip.geom.yml"
    geom.write_text(ANNOTATIONS["kpf"])
    check(
        lambda _: read_annotations(geom, image_size=(1920, 1080)),
        tmp_path / "clip.types.yml",
        TYPES,
        "types",
    )


def test_activities(tmp_path):
    check(read_activities, tmp_path / "clip.activities.yml", ACTIVITIES, "activities")


@pytest.mark.parametrize("read", [read_ground_map, read_reference])
@pytest.mark.parametrize("name", HOMOGRAPHIES)
def test_homographies(tmp_path, name, read):
    check(
        lambda path: read(path, image_size=(640, 480)),
        tmp_path / "a_homography_img2world.txt",
        HOMOGRAPHIES[name],
        name,
    )


def test_points(tmp_path):
    check(
        lambda path: read_points(path, image_size=(640, 480)),
        tmp_path / "points.csv",
        "u,v\n10,20\n300.5,400\n",
        "points",
    )


def test_every_format_is_here():
    assert {*CAMERAS, "colmap"} == {known.name for known in camera_formats()}
    assert set(ANNOTATIONS) == {known.name for known in annotation_formats()}


def bomb(levels):
    """Nine nested lists of nine aliases each: 10 lines that stand for 9 ** 9 values."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, levels)]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (bomb(9) + f"image_width: *a8\nimage_height: 480\ncamera_matrix: [{K}]\n", "aliases"),
        (f"<<: {{image_width: 640}}\nimage_height: 480\ncamera_matrix: [{K}]\n", "merge keys"),
        (f"camera_matrix: [{K}]\nx: [{'1, ' * 400_000}1]\n", "characters of YAML"),
    ],
)
def test_yaml_that_grows_is_refused(tmp_path, text, message):
    path = tmp_path / "camera.yml"
    path.write_text(text)
    tracemalloc.start()
    start = time.perf_counter()
    with pytest.raises(InputError, match=message) as caught:
        read_camera(path, format="opencv-yaml")
    assert time.perf_counter() - start < 5
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()
    assert len(str(caught.value)) < 500


def test_activities_with_aliases_are_refused(tmp_path):
    path = tmp_path / "clip.activities.yml"
    path.write_text("- {'act': {'act2': &a [1], 'timespan': *a}}\n")
    with pytest.raises(InputError, match="line 1: expected one KPF packet"):
        read_activities(path)
