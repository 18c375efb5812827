"""Annotation files: real ones, their conventions, and what must be refused."""

import json
import tarfile
import time

import numpy as np
import pytest

from scene4d.core.body import COCO17
from scene4d.core.errors import InputError
from scene4d.formats.annotations import annotation_formats, read_annotations
from scene4d.formats.cameras import read_camera

SIZE = (640, 480)


def heights_m(camera, detections):
    """Heights that a known camera gives to boxes: an end-to-end check of both files' pixels."""
    box = detections.box_xyxy
    middle = (box[:, 0] + box[:, 2]) / 2
    xy, seen = camera.locate(np.column_stack([middle, box[:, 3]]))
    head, head_ok = camera.undistort(np.column_stack([middle, box[:, 1]]))
    P, v = camera.P, head[:, 1]
    ground = np.column_stack([xy, np.zeros(len(xy)), np.ones(len(xy))])
    z = (ground @ P[1] - v * (ground @ P[2])) / (v * P[2, 2] - P[1, 2])
    return z[head_ok & seen]


def read(tmp_path, name, text, **options):
    path = tmp_path / name
    path.write_text(text)
    return read_annotations(path, **{"image_size": SIZE} | options)


def test_pets(shared_data):
    folder = shared_data / "pets2009"
    start = time.perf_counter()
    found = read_annotations(folder / "PETS2009-S2L1.xml", image_size=(768, 576), fps=10.0)
    assert time.perf_counter() - start < 1.0
    assert len(found) == 4650
    assert (found.frame.min(), found.frame.max()) == (0, 794)
    assert len(np.unique(found.track)) == 19
    np.testing.assert_allclose(
        found.box_xyxy[0, [0, 2]], [514.7109 - 31.03 / 2, 514.7109 + 31.03 / 2]
    )
    np.testing.assert_allclose(
        found.box_xyxy[0, [1, 3]], [195.2731 - 75.17 / 2, 195.2731 + 75.17 / 2]
    )
    np.testing.assert_allclose(found.time_s, found.frame / 10)
    heights = heights_m(read_camera(folder / "View_001.xml"), found)
    assert np.median(heights) == pytest.approx(1.75, abs=0.03)


def test_towncentre_half_resolution(shared_data):
    folder = shared_data / "towncentre"
    found = read_annotations(folder / "TownCentreGTHalfRes.csv", image_size=(1920, 1080))
    assert len(found) == 71460
    np.testing.assert_allclose(found.box_xyxy[0], [234.5, 770.5, 368.5, 1100.5])
    assert found.frame[0] == 0
    assert np.isnan(found.time_s).all()
    # Its bodies were made 1.90 m tall with this very camera; half a pixel of 540 rows is 1 cm.
    heights = heights_m(read_camera(folder / "TownCentre-calibration.ci"), found)
    assert np.median(heights) == pytest.approx(1.90, abs=0.02)


def test_mot_detections(shared_data):
    found = read_annotations(shared_data / "pets2009" / "frcnn_det.txt", image_size=(768, 576))
    assert len(found) == 4359
    assert (found.frame.min(), found.frame.max()) == (0, 794)
    assert set(found.track) == {-1}
    np.testing.assert_allclose(found.box_xyxy[0], [649.441, 231.502, 693.858, 317.632])
    assert found.score[0] == 0.995474


def test_swapped_boxes_of_the_tracker_are_told_or_dropped(shared_data):
    path = shared_data / "towncentre" / "tracker_boxes.txt"
    with pytest.raises(InputError, match=r"tracker_boxes\.txt: line 323: .*swapped"):
        read_annotations(path, image_size=(1920, 1080))
    with pytest.warns(UserWarning, match=r"left out 2 of 541 boxes.*line 323"):
        found = read_annotations(path, image_size=(1920, 1080), drop_invalid=True)
    assert len(found) == 539


def test_boxes_of_another_image_are_not_left_out_but_refused(shared_data):
    path = shared_data / "towncentre" / "tracker_boxes.txt"
    with pytest.raises(InputError, match=r"270 of 541 boxes are impossible.*this footage"):
        read_annotations(path, image_size=(768, 576), drop_invalid=True)


@pytest.fixture(scope="session")
def meva_clip(shared_data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("meva")
    clip = "2018-03-12.10-30-04.10-35-04.school.G424"
    with tarfile.open(shared_data / "meva" / "annotations.tar.xz") as archive:
        for kind in ("geom", "types"):
            member = archive.extractfile(f"annotations/{clip}.{kind}.yml")
            (folder / f"{clip}.{kind}.yml").write_bytes(member.read())
    return folder / f"{clip}.geom.yml"


def test_meva_clip_against_a_yaml_parser(meva_clip):
    import yaml

    found = read_annotations(meva_clip, image_size=(1920, 1080), fps=30.0)
    head = "".join(meva_clip.read_text().splitlines(keepends=True)[:300])
    packets = [p["geom"] for p in yaml.safe_load(head) if "geom" in p]
    assert [p["id1"] for p in packets] == found.track[: len(packets)].tolist()
    assert [p["ts0"] for p in packets] == found.frame[: len(packets)].tolist()
    boxes = [[float(x) for x in p["g0"].split()] for p in packets]
    np.testing.assert_array_equal(found.box_xyxy[: len(packets)], boxes)
    types = yaml.safe_load(meva_clip.with_name(meva_clip.name.replace("geom", "types")).read_text())
    names = {p["types"]["id1"]: next(iter(p["types"]["cset3"])) for p in types if "types" in p}
    assert [names[t] for t in found.track] == found.class_name.tolist()
    people = read_annotations(meva_clip, image_size=(1920, 1080), classes=["person"])
    assert 0 < len(people) == int((found.class_name == "person").sum())


QUOTED = "- {'geom': {'g0': '10 20 30.5 60', 'id0': 1, 'id1': 16, 'keyframe': True, 'ts0': 1167}}\n"
BARE = "- { geom: {id1: 16, id0: 1, ts0: 1167, g0: 10 20 30.5 60, keyframe: true } }\n"
DOUBLE = '- { "geom": {"id1": 16, "ts0": 1167, "g0": "10 20 30.5 60"}}\n'
TYPES = "- { types: { id1: 16, cset3: { vehicle: 0.2, person: 0.8 } } }\n"


@pytest.mark.parametrize("line", [QUOTED, BARE, DOUBLE])
def test_kpf_quoting_styles(tmp_path, line):
    (tmp_path / "a.types.yml").write_text(TYPES)
    found = read(tmp_path, "a.geom.yml", "- {'meta': 'id1: 3 of something'}\n# x\n" + line)
    assert found.frame.tolist() == [1167]
    assert found.track.tolist() == [16]
    assert found.class_name.tolist() == ["person"]
    np.testing.assert_array_equal(found.box_xyxy, [[10, 20, 30.5, 60]])


@pytest.mark.parametrize(
    ("geom", "types", "message"),
    [
        (QUOTED, None, r"a\.types\.yml beside it"),
        (QUOTED, TYPES.replace("16", "17"), "line 1: track 16 has no class"),
        (QUOTED.replace("'ts0': 1167", "'ts0': x"), TYPES, "line 1: field 'ts0'"),
        (QUOTED + "\n" + QUOTED.replace("10 20", "10 nan"), TYPES, "line 3: .*not finite"),
        (QUOTED + QUOTED.replace("10 20", "10"), TYPES, "line 2: field 'g0' must be four numbers"),
        (QUOTED + QUOTED.replace("10 20", "10 abc"), TYPES, "line 2: field 'g0' must be four"),
        (QUOTED.replace("1167", "9" * 30), TYPES, "line 1: field 'ts0'"),
        (QUOTED + "geom\n", TYPES, "line 2: expected one KPF packet"),
        (QUOTED, "- {types: {id1: 16}}\n", "line 1: field 'cset3'"),
    ],
)
def test_bad_kpf(tmp_path, geom, types, message):
    if types:
        (tmp_path / "a.types.yml").write_text(types)
    with pytest.raises(InputError, match=r"a\.geom\.yml: .*" + message):
        read(tmp_path, "a.geom.yml", geom)


def test_mot_ground_truth_layout(tmp_path):
    text = "1,7,11,21,30,60,1,1,0.5\n2,7,11,21,30,60,0,1,1\n3,8,11,21,30,60,1,3,1\n"
    found = read(tmp_path, "gt.txt", text, fps=25.0)
    assert found.frame.tolist() == [0, 2]  # the row with flag 0 is left out, frames from 0
    assert found.class_name.tolist() == ["person", "car"]
    assert found.score.tolist() == [1, 1]
    np.testing.assert_array_equal(found.box_xyxy[0], [10, 20, 40, 80])  # pixels from 1 to from 0
    np.testing.assert_allclose(found.time_s, [0, 0.08])
    # MOT15 keeps the flag but has ten columns; the name tells it from detections.
    text = "1,7,11,21,30,60,1,-1,-1,-1\n2,7,11,21,30,60,0,-1,-1,-1\n"
    assert len(read(tmp_path, "gt.txt", text)) == 1
    assert read(tmp_path, "det.txt", text).score.tolist() == [1, 0]


@pytest.mark.parametrize("separator", [",", ", ", " ", "\t", ";"])
def test_mot_separators_and_columns(tmp_path, separator):
    rows = [["1", "-1", "10", "20.5", "30", "60"], ["12", "4", "-5", "20", "30", "60"]]
    for extra in ([], ["0.5"], ["0.5", "-1", "-1", "-1"]):
        text = "# comment\n\n" + "\n".join(separator.join(row + extra) for row in rows)
        found = read(tmp_path, "det.txt", text)
        assert found.track.tolist() == [-1, 4]
        assert found.frame.tolist() == [0, 11]
        assert found.score[0] == (0.5 if extra else 1.0)
        np.testing.assert_array_equal(found.box_xyxy[0], [10, 20.5, 40, 80.5])


GOOD = "1,-1,10,20,30,60,0.9\n\n"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("2,-1,10,20,30,nan,0.9", "line 3: .*not finite"),
        ("2,-1,10,20,inf,60,0.9", "line 3: .*not finite"),
        ("2,-1,10,20,0,60,0.9", "line 3: .*empty or swapped"),
        ("2,-1,10,20,30,-60,0.9", "line 3: .*empty or swapped"),
        ("2,-1,640,20,30,60,0.9", "line 3: .*wholly outside the 640x480 image"),
        ("2,-1,10,-70,30,60,0.9", "line 3: .*wholly outside"),
        ("2,-1,10,20,30,60,abc", "line 3: expected a number, found 'abc'"),
        ("2,-1,10,20,30,60", "line 3: expected 7 columns, found 6"),
        ("0,-1,10,20,30,60,0.9", "line 3: frames count from 1, found 0"),
        ("1.5,-1,10,20,30,60,0.9", "line 3: the frame number must be a whole number, found 1.5"),
        ("2,-1,10,20,30,60,nan", "line 3: confidence is not finite"),
        ("3000000000,-1,10,20,30,60,1", "line 3: .* frame number of 20000000 or more"),
    ],
)
def test_bad_mot_rows(tmp_path, line, message):
    with pytest.raises(InputError, match=r"det\.txt: " + message):
        read(tmp_path, "det.txt", GOOD + line + "\n")


def test_a_frame_that_no_recording_has_may_be_left_out(tmp_path):
    """A time or an identifier in the place of a frame: two lines once took all memory."""
    text = GOOD * 4 + "3000000000,-1,10,20,30,60,0.9\n"
    with pytest.warns(UserWarning, match="left out 1 of 5 boxes"):
        assert read(tmp_path, "det.txt", text, drop_invalid=True).frame.max() == 0


def test_boxes_cut_by_the_border_are_kept(tmp_path):
    text = "1,-1,-20,-30,30,60,1\n1,-1,620,460,100,100,1\n1,-1,-10,-10,2000,2000,1\n"
    assert len(read(tmp_path, "det.txt", text)) == 3


PETS = """<dataset>
  <frame number="4"><objectlist>
    <object id="9"><box h="40" w="20" xc="100" yc="200"/></object>
  </objectlist></frame>
</dataset>"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('w="20"', 'w="0"', "frame 4, object 9: .*empty or swapped"),
        ('w="20"', 'w="nan"', "frame 4, object 9: .*not finite"),
        ('w="20"', 'w="wide"', "frame 4, object 9: the box needs .*'wide'"),
        (' w="20"', "", "frame 4, object 9: the box needs numbers"),
        ('xc="100"', 'xc="1000"', "frame 4, object 9: .*wholly outside"),
        ('number="4"', 'number="four"', "<frame> 1: number must be a whole number, found 'four'"),
        ('id="9"', f'id="{10**30}"', "frame 4: <object>: id must be a whole number"),
        ("</dataset>", "", "line [45]: is not well-formed XML"),
        ("<dataset>", '<!DOCTYPE d [<!ENTITY e "x">]><dataset>', ".*refused"),
    ],
)
def test_bad_pets(tmp_path, old, new, message):
    assert read(tmp_path, "a.xml", PETS).frame.tolist() == [4]
    with pytest.raises(InputError, match=r"a\.xml: " + message):
        read(tmp_path, "a.xml", PETS.replace(old, new))


def test_towncentre_top(tmp_path):
    head, body = "900,200,930,240", "880,200,960,450.5"
    text = f"3,0,1,1,{head},{body}\n3,1,1,0,{head},0,0,0,0\n"
    found = read(tmp_path, "TownCentre-groundtruth.top", text, image_size=(1920, 1080))
    np.testing.assert_array_equal(found.box_xyxy, [[880, 200, 960, 450.5]])
    assert (found.track[0], found.frame[0]) == (3, 0)
    half = read(tmp_path, "TownCentre-groundtruth.top", text, image_size=(960, 540))
    np.testing.assert_allclose(half.box_xyxy, [[439.75, 99.75, 479.75, 225.0]])
    with pytest.raises(InputError, match="aspect ratio differs"):
        read(tmp_path, "TownCentre-groundtruth.top", text, image_size=(640, 480))


def coco():
    keypoints = [0.0, 0.0, 0] * 16 + [50.0, 90.0, 2]
    return {
        "images": [
            {"id": 9, "file_name": "clip2/frame_0248.jpg", "width": 640, "height": 480},
            {"id": 4, "file_name": "clip2/frame_0000.jpg", "width": 640, "height": 480},
        ],
        "categories": [
            {"id": 1, "name": "person", "keypoints": list(COCO17)},
            {"id": 3, "name": "car"},
        ],
        "annotations": [
            {"id": 1, "image_id": 9, "category_id": 1, "bbox": [10, 20, 30, 60],
             "keypoints": keypoints, "track_id": 5},
            {"id": 2, "image_id": 4, "category_id": 3, "bbox": [10, 20, 30, 60], "score": 0.5},
            {"id": 3, "image_id": 4, "category_id": 1, "bbox": [0, 0, 0, 0], "iscrowd": 1},
        ],
    }  # fmt: skip


def test_coco(tmp_path):
    values = coco()
    found = read(tmp_path, "a.json", json.dumps(values))
    assert found.frame.tolist() == [248, 0]
    assert found.class_name.tolist() == ["person", "car"]
    assert found.track.tolist() == [5, -1]
    assert found.score.tolist() == [1, 0.5]
    np.testing.assert_array_equal(found.box_xyxy[0], [10, 20, 40, 80])
    assert found.keypoint_names == COCO17
    assert np.isnan(found.keypoint_uv[0, :16]).all()
    np.testing.assert_array_equal(found.keypoint_uv[0, 16], [50, 90])
    assert found.keypoint_score[0, 16] == 1
    assert found.keypoint_score[1].sum() == 0
    values["images"][0]["file_name"] = "frame.jpg"  # no digits: the rank by id
    assert read(tmp_path, "a.json", json.dumps(values)).frame.tolist() == [1, 0]
    assert len(read(tmp_path, "a.json", json.dumps(values), classes={"car"})) == 1


def test_coco_results(tmp_path):
    keypoints = [50.0, 90.0, 0.25] * 17
    results = [
        {"image_id": 12, "category_id": 1, "bbox": [10, 20, 30, 60], "score": 0.75,
         "keypoints": keypoints}
    ]  # fmt: skip
    found = read(tmp_path, "a.json", json.dumps(results))
    assert (found.frame[0], found.score[0], found.class_name[0]) == (12, 0.75, "person")
    np.testing.assert_array_equal(found.keypoint_score, np.full((1, 17), 0.25))


def spoil(values, path, value):
    *parents, last = path
    for key in parents:
        values = values[key]
    values[last] = value


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("annotations", 1, "bbox"), [10, 20, 0, 60], r"annotations\[1\]: .*empty or swapped"),
        (
            ("annotations", 1, "bbox"),
            [10, 20, 30],
            r"'annotations\[1\]\.bbox' must be 4 finite",
        ),
        (("annotations", 1, "bbox"), [10, 20, None, 5], r"'annotations\[1\]\.bbox' must .*None"),
        (
            ("annotations", 1, "bbox"),
            [10, 20, float("nan"), 5],
            r"'annotations\[1\]\.bbox' must be 4 finite",
        ),
        (("annotations", 1, "bbox"), [700, 20, 5, 5], r"annotations\[1\]: .*outside"),
        (
            ("annotations", 1, "image_id"),
            77,
            "image_id' must be the id of one of the images, found 77",
        ),
        (
            ("annotations", 1, "image_id"),
            "x",
            r"'annotations\[1\]\.image_id' must be a whole",
        ),
        (
            ("annotations", 1, "category_id"),
            77,
            "category_id' must be the id of one of the categories",
        ),
        (
            ("annotations", 0, "keypoints"),
            [1, 2, 2],
            r"'annotations\[0\]\.keypoints' must be x, y, v of each of 17 names",
        ),
        (("images", 1, "width"), 1920, r"images\[1\] is 1920x480, but the footage is 640x480"),
        (
            ("annotations", 0, "track_id"),
            10**30,
            r"\.track_id' must be a whole number",
        ),
        (("images", 1, "id"), 9, "two images have the same id"),
        (("annotations",), 3, "field 'annotations' must be a list of objects, found 3"),
    ],
)
def test_bad_coco(tmp_path, path, value, message):
    values = coco()
    spoil(values, path, value)
    with pytest.raises(InputError, match=r"a\.json: .*" + message):
        read(tmp_path, "a.json", json.dumps(values))


def test_unreadable_and_unknown(tmp_path):
    with pytest.raises(InputError, match="the file is empty"):
        read(tmp_path, "a.txt", "")
    with pytest.raises(InputError, match=r"recognises this file; give its format, one of .*mot"):
        read(tmp_path, "a.txt", "hello")
    with pytest.raises(InputError, match="is a folder"):
        read_annotations(tmp_path, image_size=SIZE)
    with pytest.raises(InputError, match="cannot be read"):
        read_annotations(tmp_path / "missing.txt", image_size=SIZE)
    with pytest.raises(InputError, match=r"format 'x' is unknown; known: coco, pets, .*mot"):
        read(tmp_path, "a.txt", GOOD, format="x")
    with pytest.raises(InputError, match="fps must be positive"):
        read(tmp_path, "a.txt", GOOD, fps=0.0)
    assert len(read(tmp_path, "a.dat", GOOD, format="mot")) == 1
    names = [f.name for f in annotation_formats()]
    assert len(set(names)) == len(names) == 8
