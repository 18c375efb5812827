"""A good file of every format that is text, to be spoilt (fuzzing)."""

import json

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
SQUARE = [[0, 0], [4, 0], [4, 4], [0, 4]]
HOMOGRAPHIES = {
    "text": "0.01 0.002 -5\n0.001 -0.03 20\n0.0001 0.002 1\n",
    "json": '{"H": [[0.01, 0.002, -5], [0.001, -0.03, 20], [0.0001, 0.002, 1]]}',
}
POINTS = "u,v\n10,20\n300.5,400\n"
ORIENTATION = json.dumps(
    {"focal_px": 900, "tilt_deg": 20, "roll_deg": 1, "sigma": {"focal_px": 40, "tilt_deg": 1}}
)
LANDMARKS = json.dumps(
    {
        "points": [
            {"uv": [412, 530], "xy_m": [0.0, 0.0], "name": "drain"},
            {"uv": [1210, 488], "xy_m": [8.4, 2.0], "sigma_m": 0.02},
        ],
        "uprights": [{"foot_uv": [90, 610], "head_uv": [88, 402], "height_m": 2.1}],
        "distances": [{"uv": [[412, 530], [700, 900]], "distance_m": 12.3}],
    }
)
LANDMARK_TABLE = "u,v,x_m,y_m,name\n412,530,0,0,drain\n1210,488,8.4,2.0,pole\n"
ANCHORS = json.dumps(
    {
        "points": [
            {"camera": "a", "u": 10, "v": 400, "lat": 53.44, "lon": -0.94},
            {"camera": "b", "u": 90, "v": 500, "lat": 53.441, "lon": -0.942},
        ]
    }
)
ANCHOR_TABLE = "camera,u,v,x_m,y_m\na,10,400,1.5,2\nb,90,500,3.5,2\n"
PLACES = json.dumps(
    {
        "zones": {"gate": [[0, 0], [4, 0], [4, 4]], "till": {"camera": "c", "points": SQUARE}},
        "lines": {"kerb": [[0, 0], [9, 1]]},
    }
)
GEOJSON = json.dumps(
    {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature",
                "properties": {"name": "gate", "camera": "c"},
                "geometry": {"type": "Polygon", "coordinates": [[*SQUARE, SQUARE[0]]]},
            }
        ],
    }
)
CATALOGUE = """classes: {motor: &motor [car, truck]}
activities:
  lingers:
    description: Somebody stands by a vehicle.
    phrases: [person lingers near vehicle]
    roles: {person: person, vehicle: *motor}
    phases:
      - name: stays
        lasts: [0.6, 4]
        holds: ["near(person, vehicle)", "not speed_below(person, speed_mps=1)"]
      - name: goes
        lasts: [0.2, 1]
        gap: 2
        unseen: [0, 1.5]
        holds: ["disappears_into(person, vehicle, sigma_s=0.5)"]
"""
