"""Colours of clothes and vehicles, as probabilities: drawn people of known colours."""

import cv2
import numpy as np
import pytest

from drawn_colours import scene
from scene4d.core.colours import (
    CLOTHES,
    NAMES,
    PALETTE,
    PARTS,
    colour_probability,
    is_colour,
    log_likelihood,
    members,
)
from scene4d.core.people import Detections
from scene4d.perception.colours import ColourReader, light_gain, to_lab
from scene4d.tracking._colours import Colours


def chances(seed: int, scenes: int, **how) -> tuple[np.ndarray, np.ndarray]:
    """Probabilities of all names (n, 11) in made scenes, and the true ones."""
    rng = np.random.default_rng(seed)
    found, truth = [], []
    for _ in range(scenes):
        worn, colours, person = scene(rng, **how)
        for row, names in enumerate(worn):
            for part, name in zip(PARTS[: 1 + person[row]], names, strict=False):
                one, clothes = colours[row : row + 1].astype(float), person[row : row + 1]
                found.append([colour_probability(one, n, part, clothes)[0] for n in NAMES])
                truth.append(NAMES.index(name))
    return np.array(found), np.array(truth)


def test_probabilities_mean_what_they_say_under_lights_in_shade_and_noise():
    """On the careful side: real pictures have more in them than these."""
    found, truth = chances(1, 24, looks=3)
    likeliest = found.max(axis=1)
    right = found.argmax(axis=1) == truth
    assert 0.65 < right.mean() < 0.85
    for low, high in ((0.0, 0.7), (0.7, 0.9), (0.9, 1.01)):
        inside = (likeliest >= low) & (likeliest < high)
        few = 2 * np.sqrt(0.25 / inside.sum())
        assert -0.05 - few < right[inside].mean() - likeliest[inside].mean() < 0.2 + few
    is_so = np.eye(len(NAMES))[truth]
    said = np.abs(found[is_so == 1].mean() - (found**2).sum(axis=1).mean())
    assert said < 0.08  # P(true name) on average is what probabilities expect of themselves


def test_a_wrong_white_balance_costs_some_answers_and_not_calibration():
    found, truth = chances(2, 10, cast=0.25, looks=3)
    right = found.argmax(axis=1) == truth
    assert right.mean() > 0.55 and found.max(axis=1).mean() - right.mean() < 0.15


@pytest.mark.parametrize("name", PALETTE)
def test_what_looks_as_a_name_does_is_called_so(name):
    shade = {"dark": 25, "light": 74}.get(name.split()[0], 48)
    hue, chroma = {
        "black": (0, 0), "white": (0, 0), "grey": (0, 0), "red": (27, 50), "orange": (58, 62),
        "yellow": (92, 62), "green": (140, 35), "blue": (275, 30), "brown": (65, 22),
        "purple": (317, 32), "pink": (3, 35),
    }[name.split()[-1]]  # fmt: skip
    chroma *= {"dark": 0.6, "light": 0.65}.get(name.split()[0], 1.0)
    light = {"black": 12, "dark grey": 36, "white": 92, "orange": 60, "yellow": 80, "pink": 60}.get(
        name, shade
    )
    turn = np.radians(hue)
    lab = np.array([[light, chroma * np.cos(turn), chroma * np.sin(turn)]])
    assert PALETTE[int(log_likelihood(lab, np.ones(1)).argmax())] == name


def test_lab_is_that_of_opencv():
    rng = np.random.default_rng(0)
    bgr = rng.integers(0, 256, (1, 200, 3), dtype=np.uint8)
    expected = cv2.cvtColor(bgr.astype(np.float32) / 255, cv2.COLOR_BGR2Lab)
    shown = bgr / 255
    linear = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(to_lab(linear), expected, atol=0.3)


def test_names_and_shades_select_entries():
    assert members("red").sum() == 2 and members("dark red").sum() == 1
    assert PALETTE[int(np.argmax(members("dark black")))] == "black"
    assert members("dark")[PALETTE.index("black")] and not members("dark")[PALETTE.index("red")]
    assert not is_colour("light orange") and not is_colour("") and not is_colour("tartan")
    every = sum(members(name).astype(int) for name in NAMES)
    assert (every == 1).all() and CLOTHES.sum() == pytest.approx(1)


def person(box, **more) -> Detections:
    return Detections.from_boxes((200, 200), np.zeros(1, int), np.array([box], float), **more)


def coloured_image(bgr=(40, 40, 200)) -> np.ndarray:
    image = np.random.default_rng(0).integers(60, 200, (200, 200, 3), dtype=np.uint8)
    image[60:160, 60:120] = bgr
    return image


def test_boxes_without_keypoints_are_read_and_hidden_or_tiny_ones_are_not():
    image, box = coloured_image(), [60, 50, 120, 180]
    reading = ColourReader().read(image, 0.0, person(box))[0]
    assert reading[1] > 35 and np.isfinite(reading).all()
    assert np.isnan(ColourReader().read(image, 0.0, person([60, 60, 66, 74]))).all()
    both = Detections.from_boxes(
        (200, 200), np.zeros(2, int), np.array([box, [50, 60, 130, 190]], float)
    )
    assert np.isnan(ColourReader().read(image, 0.0, both)[0]).all()
    outside = person([-80, 50, 20, 180])
    assert np.isnan(ColourReader().read(image, 0.0, outside)).all()


def test_it_reads_a_few_times_a_second_only():
    reader, seen = ColourReader(), person([60, 50, 120, 180])
    times = np.arange(0, 2, 0.1)
    read = [np.isfinite(reader.read(coloured_image(), t, seen)).any() for t in times]
    assert sum(read) == 5 and read[0]


def test_night_and_infrared_show_no_colours():
    grey = np.repeat(coloured_image()[..., :1], 3, axis=2)
    for image in (grey, coloured_image() // 12):
        assert light_gain(image) is None
        assert np.isnan(ColourReader().read(image, 0.0, person([60, 50, 120, 180]))).all()


def test_many_looks_are_hardly_surer_than_one():
    """Looks err alike; and one glance determines nothing."""
    reading = np.tile([50.0, 12.0, 8.0, 4.0, *[np.nan] * 4], (1, 1))
    told = Colours()
    sure = []
    for k in range(200):
        told.add(person([0, 0, 9, 9], time_s=np.array([k * 0.5])), np.zeros(1, int), reading)
        sure.append(told.of(np.zeros(1, int), np.array(["person"]))[0].max())
    once = np.exp(log_likelihood(reading[:, :3], reading[:, 3])[0] + np.log(CLOTHES))
    most = np.exp(1.25 * log_likelihood(reading[:, :3], reading[:, 3])[0] + np.log(CLOTHES))
    assert sure[0] == pytest.approx(once.max() / once.sum(), rel=1e-3)
    assert sure[-1] == pytest.approx(most.max() / most.sum(), abs=0.01)
    unknown = told.of(np.array([7]), np.array(["person"]))
    assert (unknown == 0).all()
    common = colour_probability(unknown.astype(float), "red", "upper", np.array([True]))
    assert common[0] == pytest.approx(CLOTHES[members("red")].sum())
    told.forget(1e3)
    assert (told.of(np.zeros(1, int), np.array(["person"])) == 0).all()


def test_nobody_has_no_colours():
    """As in the first second of a stream."""
    assert Colours().of(np.zeros(0, int), np.zeros(0, str)).shape[0] == 0
