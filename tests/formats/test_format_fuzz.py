"""Spoilt files end in a reading or in an InputError, never in another exception."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import read_camera

K = "600, 0, 319.5, 0, 600, 239.5, 0, 0, 1"
CAMERAS = {
    "opencv-yaml": "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n"
    f"camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ {K} ]\n"
    "rvec: [1.5, 0.1, 0]\ntvec: [0, 1, 2]\n",
    "opencv-xml": "<opencv_storage><image_width>640</image_width><image_height>480</image_height>"
    '<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>'
    f"<data>{K.replace(',', ' ')}</data></camera_matrix></opencv_storage>",
    "krtd": "600 0 319.5\n0 600 239.5\n0 0 1\n1 0 0\n0 0 -1\n0 1 0\n0 5 0\n0 0\n",
    "ros": f"image_width: 640\nimage_height: 480\ncamera_matrix: {{data: [{K}]}}\n"
    "distortion_model: plumb_bob\ndistortion_coefficients: {data: [0, 0, 0, 0, 0]}\n",
    "deepstream": "projectionMatrix_3x4: [600, 0, 0, 0, 0, 0, -600, 600, 0, 1, 0, 0]\n"
    "modelInfo: {height: 170}\n",
    "matrix": "600 0 319.5 0\n0 600 239.5 0\n0 0 1 0\n",
    "tsai": '<C><Geometry width="768" height="576" dpx="5e-3" dpy="5e-3"/><Intrinsic focal="5.5" '
    'kappa1="5e-3" cx="380" cy="280" sx="1.0"/><Extrinsic tx="0" ty="0" tz="1" rx="2" ry="0" '
    'rz="0"/></C>',
    "json": json.dumps({"schema": "scene4d/camera/1", "image_size": [640, 480]}),
}
ANNOTATIONS = {
    "mot": "1,-1,10,20,30,60,0.9\n2,-1,10,20,30,60,0.9\n",
    "pets": '<d><frame number="4"><objectlist><object id="9"><box h="40" w="20" xc="100" '
    'yc="200"/></object></objectlist></frame></d>',
    "kpf": "- {'geom': {'g0': '10 20 30 60', 'id1': 16, 'ts0': 1167}}\n",
    "virat": "0 3 0 100 200 30 60 1\n1 900 0 800 500 120 70 2\n",
    "towncentre-top": "3,0,1,1,900,200,930,240,880,200,960,450.5\n",
    "coco": '{"images":[{"id":1,"file_name":"f_2.jpg"}],"categories":[{"id":1,"name":"person"}],'
    '"annotations":[{"image_id":1,"category_id":1,"bbox":[10,20,30,60],"keypoints":[]}]}',
}
TOKENS = ["", "-", "nan", "inf", "1e400", "0", "²", "null", "[", "]", "{}", ",", "\n", "true", "'"]
EDITS = st.lists(st.tuples(st.floats(0, 1), st.integers(0, 4), st.sampled_from(TOKENS)), max_size=3)


def spoil(text, edits):
    for place, length, token in edits:
        start = int(place * len(text))
        text = text[:start] + token + text[start + length :]
    return text


@pytest.mark.parametrize("name", CAMERAS)
@settings(max_examples=60, deadline=None)
@given(edits=EDITS)
def test_cameras(tmp_path_factory, name, edits):
    path = tmp_path_factory.getbasetemp() / f"fuzz-{name}"
    path.write_text(spoil(CAMERAS[name], edits))
    try:
        read_camera(path, format=name, image_size=(640, 480))
    except InputError as error:
        assert str(error).startswith(f"{path}: ")


@pytest.mark.parametrize("name", ANNOTATIONS)
@settings(max_examples=60, deadline=None)
@given(edits=EDITS)
def test_annotations(tmp_path_factory, name, edits):
    path = tmp_path_factory.getbasetemp() / f"fuzz-{name}"
    path.with_name(path.name + ".types.yml").write_text(
        "- {types: {id1: 16, cset3: {person: 1}}}\n"
    )
    path.write_text(spoil(ANNOTATIONS[name], edits))
    try:
        read_annotations(path, format=name, image_size=(1920, 1080))
    except InputError as error:
        assert str(error).startswith(f"{path}: ")
