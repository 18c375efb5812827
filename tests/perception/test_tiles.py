import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.perception.detectors.tiles import choose_tiles, cut_by_tile, tile_grid

sizes = st.tuples(st.integers(1, 4000), st.integers(1, 3000))


@given(sizes, st.integers(100, 1400))
def test_tiles_cover_the_image_and_overlap(size, tile_px):
    tiles = tile_grid(size, tile_px)
    for axis in (0, 1):
        spans = np.unique(tiles[:, [axis, axis + 2]], axis=0)
        assert spans[0, 0] == 0
        assert spans[-1, 1] == size[axis]
        assert (spans[:, 1] - spans[:, 0] == min(tile_px, size[axis])).all()
        if len(spans) > 1:
            assert (spans[:-1, 1] - spans[1:, 0]).min() >= round(0.2 * tile_px) - 1


def test_the_grid_of_the_brief():
    assert len(tile_grid((1920, 1080))) == 8
    assert len(choose_tiles((1920, 1080))) == 8
    assert len(choose_tiles((3840, 2160))) == 8
    assert len(choose_tiles((768, 576))) == 0


def test_only_inner_borders_cut():
    tile = np.array([0, 512, 640, 1152])
    boxes = np.array(
        [
            [10.0, 600, 40, 700],  # inside
            [-0.5, 600, 40, 700],  # at the image's own left border
            [600, 600, 638.5, 700],  # at the tile's right border, which the image goes beyond
            [10, 512, 40, 600],  # at the upper one
            [10, 900, 40, 1151.5],  # at the lower one, which is the image's own
        ]
    )
    cut = cut_by_tile(boxes, tile, (1920, 1152))
    assert cut.tolist() == [False, False, True, True, False]


def test_known_sizes_leave_the_tiles_where_people_are_small():
    # 20 px at row 200 and 300 px at row 1080, nobody above row 150.
    rows = np.arange(1080.0)
    height = np.where(rows >= 150, 20 + (rows - 200) * 280 / 880, np.nan)
    tiles = choose_tiles((1920, 1080), height)
    assert 0 < len(tiles) < 8
    assert (tiles[:, 1] == 0).all()
    assert np.array_equal(tiles, choose_tiles((1920, 1080), lambda v: height[v.astype(int)]))
    assert len(choose_tiles((1920, 1080), np.full(1080, 150.0))) == 0
    assert len(choose_tiles((1920, 1080), np.full(1080, 5.0))) == 0
    assert len(choose_tiles((1920, 1080), np.full(1080, np.nan))) == 0


def test_large_frames_get_tiles_as_small_as_their_people():
    coarse = choose_tiles((3840, 2160), np.full(2160, 150.0))
    fine = choose_tiles((3840, 2160), np.full(2160, 32.0))
    assert (coarse[:, 2] - coarse[:, 0]).max() == 1280
    assert (fine[:, 2] - fine[:, 0]).max() < 700


def test_one_height_per_row_is_wanted():
    with pytest.raises(InputError, match=r"found shape \(7,\), expected .* \(1080,\)"):
        choose_tiles((1920, 1080), np.ones(7))
