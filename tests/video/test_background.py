"""The scene without what moves in it."""

import numpy as np

from scene4d.video.background import MAX_BYTES, Background
from scene4d.video.frames import Frame


def frame(index: int, value: int, *, visitor: bool = False) -> Frame:
    image = np.full((80, 100, 3), value, np.uint8)
    if visitor:
        image[10:60, 5 * (index % 15) : 5 * (index % 15) + 10] = 255
    return Frame(index, float(index), image)


def test_what_passes_by_vanishes():
    background = Background((100, 80), 40)
    for index in range(40):
        background.add(frame(index, 100, visitor=True))
    assert background.is_median
    image = background.image()
    assert image is not None
    assert image.shape == (80, 100, 3)
    assert (image == 100).all()


def test_a_few_pictures_give_the_first():
    background = Background((100, 80), 2)
    assert background.image() is None
    background.add(frame(0, 10))
    background.add(frame(1, 200))
    assert not background.is_median
    image = background.image()
    assert image is not None and (image == 10).all()


def test_kept_frames_are_spread_and_bounded():
    background = Background((100, 80), 1000)
    for index in range(1000):
        background.add(frame(index, index // 4))
    assert len(background._kept) <= 21
    values = [int(image[0, 0, 0]) for image in background._kept]
    assert values[0] == 0 and values[-1] > 200
    large = Background((7680, 4320), 1000)
    assert large._room * 7680 * 4320 * 3 <= MAX_BYTES or large._room == 3


def test_a_stream_of_unknown_length_is_kept_from_its_start():
    background = Background((100, 80), None)
    for index in range(100):
        background.add(frame(index, min(index, 250)))
    assert len(background._kept) == 21
