"""Looking only where something changed: fake detectors that count, on pictures made here."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import supervision as sv

from scene4d.perception._changes import GreyCopy, changed
from scene4d.perception._postures import Postures
from scene4d.perception.detectors._base import COCO80
from scene4d.perception.detectors.tiles import Boxes, Sight, TiledDetector
from scene4d.perception.objects import ObjectDetector

SIZE = (640, 480)
CAR, PERSON = (100, 200, 260, 290), (400, 200, 430, 290)
GROUND = np.random.default_rng(0).integers(90, 110, (480, 640, 3)).astype(np.uint8)
TEXTURE = np.kron(np.random.default_rng(1).integers(0, 90, (9, 16)), np.ones((10, 10)))[..., None]


def moved(box, right):
    return (box[0] + right, box[1], box[2] + right, box[3])


def picture(*things, seed=0):
    """Ground with noise, and a rectangle of its own brightness for every thing."""
    image = GROUND.astype(int)
    for (x1, y1, x2, y2), grey in things:
        image[max(y1, 0) : y2, max(x1, 0) : x2] = grey if np.isscalar(grey) else grey[: 480 - y1]
    noise = np.random.default_rng(seed).normal(0, 2, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


class Fake(TiledDetector):
    """Finds what the test says, in whatever it is shown."""

    def __init__(self, sight=None):
        super().__init__(
            class_names=COCO80,
            sight=sight or Sight(608, 960, 20.0, 12.0),
            whole_threshold=0.3,
            tile_threshold=0.3,
        )
        self.there = []
        self.shown = []

    def infer(self, image_bgr, threshold):
        self.shown.append(image_bgr.shape[1::-1])
        boxes = np.array([b for _, b in self.there], float).reshape(-1, 4)
        label = np.array([COCO80.index(n) for n, _ in self.there], int)
        return Boxes(boxes, np.full(len(boxes), 0.8), label)


class Scene:
    """An attentive detector, ten pictures a second."""

    def __init__(self):
        self.people, self.cars = Fake(), Fake()
        told = ObjectDetector(self.people, None, self.cars).expecting(np.full(480, 100.0))
        self.objects = told.attentive()
        self.people, self.cars = told.people, told.vehicles
        self.index = 0

    def show(self, *things, people=(), cars=(), seed=None):
        image = picture(*things, seed=self.index if seed is None else seed)
        self.people.there = [("person", box) for box in people]
        self.cars.there = [("car", box) for box in cars]
        frame = SimpleNamespace(index=self.index, time_s=self.index / 10, image_bgr=image)
        self.index += 1
        before = len(self.cars.shown)
        found, *_ = self.objects.look(frame)
        self.looked = len(self.cars.shown) > before
        return found.select(found.class_name == "car").box_xyxy


def test_noise_and_light_are_no_change_and_a_person_far_away_is_one():
    before = GreyCopy(picture(seed=1))
    after = picture(seed=2)
    brighter = np.clip(after.astype(int) + 25, 0, 255).astype(np.uint8)
    for image in (after, brighter):
        assert not changed(GreyCopy(image).grey, before.grey).any()
    somebody = GreyCopy(picture(((300, 200, 306, 214), 60), seed=3))
    mask = changed(somebody.grey, before.grey)
    assert mask[somebody.cells(np.array([300, 200, 306, 214]))].mean() > 0.8
    assert mask.sum() < 150


def test_a_parked_car_is_looked_at_rarely_and_reported_always():
    scene, looks = Scene(), 0
    for _ in range(100):
        found = scene.show((CAR, 30), cars=[CAR])
        looks += scene.looked
        assert len(found) == 1 and np.allclose(found, CAR)
    assert 4 <= looks <= 5  # three at first, then one in 5 s


def test_somebody_who_walks_past_does_not_make_it_look_at_vehicles():
    scene, looks = Scene(), 0
    for k in range(60):
        person = moved(PERSON, 4 * k - 100)
        found = scene.show((CAR, 30), (person, 200), people=[person], cars=[CAR])
        looks += scene.looked
        assert len(found) == 1
    assert looks <= 5
    assert 15 <= len(scene.people.shown) <= 60


def test_a_car_that_drives_is_followed_between_looks_and_never_found_where_it_was():
    scene, looks = Scene(), 0
    for _ in range(20):
        scene.show((CAR, TEXTURE), cars=[CAR])
    for k in range(1, 34):
        box = moved(CAR, 10 * k)
        found = scene.show((box, TEXTURE), cars=[box])
        looks += scene.looked
        if k >= 5:
            assert len(found) == 1
            assert np.abs(found[0] - box).max() < 12 + 3 * (k < 10)
    assert 9 <= looks <= 16  # three a second
    for _ in range(7):
        found = scene.show()
    assert len(found) == 0


def test_what_is_taken_for_a_car_once_is_not_carried_on():
    scene = Scene()
    counts = [len(scene.show(cars=[CAR] if k == 3 else [])) for k in range(10)]
    assert counts == [0, 0, 0, 1, *[0] * 6]
    scene = Scene()  # and what is missed once is
    counts = [len(scene.show((CAR, 30), cars=[CAR] if k != 3 else [])) for k in range(10)]
    assert counts == [1] * 10


def test_what_follows_a_beginning_depends_on_nothing_before():
    def run(scene, frames):
        out = []
        for k in frames:
            box = moved(CAR, 3 * k)
            flicker = [CAR] if k % 3 else []
            out.append(scene.show((box, 30), cars=[box, *flicker], seed=k))
        return out

    whole = Scene()
    run(whole, range(15))
    whole.objects.begin()
    fresh = Scene()
    fresh.index = 15
    for a, b in zip(run(whole, range(15, 40)), run(fresh, range(15, 40)), strict=True):
        assert np.array_equal(a, b)


def test_only_tiles_that_changed_are_looked_at():
    detector = Fake(Sight(100, 250, 20.0, 1.0))
    objects = ObjectDetector(detector).attentive()
    tiles = detector.regions(SIZE)
    assert len(tiles) > 5
    for k, thing in enumerate([(0, 0, 1, 1), (10, 10, 40, 60)]):
        image = picture((thing, 200), seed=k)
        objects.look(SimpleNamespace(index=k, time_s=k / 2, image_bgr=image))
    assert len(detector.shown) == len(tiles) + 2  # the whole picture, and the tile in its corner


def test_who_crosses_another_is_looked_at_in_every_picture():
    def looks(other):
        scene = Scene()
        for k in range(30):
            here = [moved(PERSON, 3 * k), moved(other, 3 * k)]
            scene.show(*((box, TEXTURE[:, :30]) for box in here), people=here)
        return len(scene.people.shown)

    alone, beside = looks(moved(PERSON, 60)), looks(moved(PERSON, 15))
    assert alone <= 15 and beside >= 25


def test_looking_at_many_frames_side_by_side_finds_what_one_after_the_other_finds():
    frames = []
    for k in range(12):
        image = picture((moved(CAR, 10 * k), TEXTURE), (moved(PERSON, -9 * k), 220), seed=k)
        frames.append(SimpleNamespace(index=k, time_s=k / 10, image_bgr=image))
    there = {"people": ("person", PERSON), "cars": ("car", CAR)}
    found = []
    for way in ("looks", "look"):
        scene = Scene()
        for name, thing in there.items():
            getattr(scene, name).there = [thing]
        if way == "looks":
            found.append([moment[2:] for moment in scene.objects.looks(iter(frames))])
        else:
            found.append([scene.objects.look(frame) for frame in frames])
    for (a, colours, read), (b, same, read_again) in zip(*found, strict=True):
        assert np.array_equal(read, read_again, equal_nan=True)
        assert a.frame.tolist() == b.frame.tolist() and len(a) >= 1
        assert np.array_equal(a.box_xyxy, b.box_xyxy) and np.array_equal(colours, same)


def people(number, looked_s):
    """Two people at the same places."""
    data = {"number": np.array(number), "looked_s": np.array(looked_s, float)}
    return sv.Detections(np.array([[10.0, 20, 30, 60], [100, 20, 120, 60]]), data=data)


def test_keypoints_move_and_grow_with_the_box_and_are_taken_anew_after_a_while_if_looked_at():
    postures, taken = Postures(), []
    for k in range(16):
        here = people([3, 4], [k / 10, 0.0])
        here.xyxy[0] = np.array([10.0, 20, 30, 60]) * (1 + k / 20) + 2 * k  # comes nearer
        uv, score, rows = postures.carried(here, k / 10, 1)
        taken.append(rows.tolist())
        middle = (here.xyxy[:, :2] + here.xyxy[:, 2:]) / 2
        uv[rows], score[rows] = middle[rows, None], 0.9
        assert np.allclose(uv[:, 0], middle) and (score == 0.9).all()
        postures.keep(here, uv, score)
    assert [k for k, rows in enumerate(taken) if 0 in rows] == [0, 7, 14]
    assert [k for k, rows in enumerate(taken) if 1 in rows] == [0]


def test_keypoints_of_who_keeps_still_are_taken_once_a_second():
    postures, taken = Postures(), []
    for k in range(25):
        here = people([3, 4], [k / 10, k / 10])
        here.xyxy[0] += 0.5 * (-1) ** k  # a detector's jitter
        here.xyxy[1, 1] += 4 * (k >= 12)  # bends down
        uv, score, rows = postures.carried(here, k / 10, 1)
        uv[rows], score[rows] = 0.0, 0.9
        postures.keep(here, uv, score)
        taken += [(k, row) for row in rows.tolist()]
    assert [k for k, row in taken if row == 0] == [0, 10, 20]
    assert [k for k, row in taken if row == 1] == [0, 10, 17]


def test_keypoints_of_somebody_new_are_taken():
    postures = Postures()
    for number in ([3, 4], [4, 5]):
        here = people(number, [0.0, 0.0])
        uv, score, rows = postures.carried(here, 0.1, 1)
        uv[rows], score[rows] = np.array(number)[rows, None, None], 1.0
        postures.keep(here, uv, score)
    assert rows.tolist() == [1] and uv[:, 0, 0].tolist() == [4 - 90, 5]  # in the other box


class CloseUp(Fake):
    """Finds bright things in whatever it is shown, also side by side."""

    canvases = ((128, 96), (256, 256))

    def infer(self, image_bgr, threshold):
        self.shown.append(image_bgr.shape[1::-1])
        light = (image_bgr.mean(axis=2) > 180).astype(np.uint8)
        _, _, stats, _ = cv2.connectedComponentsWithStats(light)
        box = np.array([[x, y, x + w, y + h] for x, y, w, h, a in stats[1:] if a > 100], float)
        n = len(box)
        return Boxes(box.reshape(-1, 4) - 0.5, np.full(n, 0.8), np.zeros(n, int))

    def infer_canvas(self, canvas, threshold):
        found = self.infer(canvas, threshold)
        return found._replace(xyxy=found.xyxy + 0.5)


def test_closer_looks_replace_looks_at_tiles_and_find_the_same_boxes():
    detector = CloseUp(Sight(200, 300, 20.0, 1.0))
    objects = ObjectDetector(detector).expecting(np.full(480, 60.0)).attentive()
    tiles = len(detector.regions(SIZE))
    worst, close = 0.0, 0
    for k in range(30):
        walkers = [(60 + 4 * k, 200, 80 + 4 * k, 260), (400 - 3 * k, 300, 420 - 3 * k, 360)]
        image = picture(*((w, 255) for w in walkers), seed=k)
        before = len(detector.shown)
        found, *_ = objects.look(SimpleNamespace(index=k, time_s=k / 10, image_bgr=image))
        looks = detector.shown[before:]
        close += sum(size in detector.canvases for size in looks)
        assert len(looks) == tiles or k % 10
        box = found.box_xyxy[np.argsort(found.box_xyxy[:, 0])]
        want = np.array(sorted(walkers)) - 0.5
        worst = max(worst, np.abs(box - want).max())
    assert close >= 5
    assert worst < 6


@pytest.mark.weights
def test_yolox_sees_the_same_without_the_padding_of_a_square(detector, pets_frames, monkeypatch):
    boxes = {}
    for name in ("rectangle", "square"):
        if name == "square":
            monkeypatch.setattr(type(detector), "_canvas_size", lambda self, size: (416, 416))
        boxes[name] = [detector.detect(f.image_bgr) for f in pets_frames[::20]]
    total = 0
    for there, here in zip(boxes["square"], boxes["rectangle"], strict=True):
        sure = there[there.confidence > 0.5]
        near = sv.box_iou_batch(sure.xyxy, here.xyxy)
        assert (near.max(axis=1) > 0.9).all()
        assert np.abs(sure.confidence - here.confidence[near.argmax(axis=1)]).max() < 0.1
        total += len(sure)
    assert total > 15
    portrait = cv2.rotate(pets_frames[0].image_bgr, cv2.ROTATE_90_CLOCKWISE)
    monkeypatch.undo()
    assert isinstance(detector.detect(portrait), sv.Detections)
