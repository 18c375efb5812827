"""Overlap of boxes beside supervision's, and where there is none."""

import numpy as np
import pytest
import supervision as sv
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from scene4d.core.boxes import area_px2, covered, iou

CORNERS = arrays(float, (5, 2, 2), elements=st.floats(0, 500, width=32))


@given(CORNERS, CORNERS)
def test_overlaps_are_those_of_supervision(a, b):
    first, second = (
        np.concatenate([np.sort(one, axis=1)[:, 0], np.sort(one, axis=1)[:, 1] + 1], axis=1)
        for one in (a, b)
    )
    expected = sv.box_iou_batch(first, second)
    np.testing.assert_allclose(iou(first[:, None], second), expected, atol=1e-6)
    shared = covered(first[:, None], second) * area_px2(first)[:, None]
    np.testing.assert_allclose(shared, (covered(second[:, None], first).T * area_px2(second)))


def test_the_share_that_is_covered():
    box = np.array([[0.0, 0.0, 10.0, 10.0], [0.0, 0.0, 20.0, 20.0]])
    np.testing.assert_allclose(covered(box, np.array([0.0, 0.0, 10.0, 10.0])), [1.0, 0.25])


@pytest.mark.parametrize(("box", "expected"), [([5.0, 5.0, 5.0, 5.0], 0.0), ([np.nan] * 4, np.nan)])
def test_boxes_without_an_area_or_place(box, expected):
    assert iou(np.array(box), np.array(box)) == pytest.approx(expected, nan_ok=True)
    assert covered(np.array(box), np.array(box)) == pytest.approx(expected, nan_ok=True)
