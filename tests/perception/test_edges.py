"""Straight edges: found where drawn, none from borders, black frames or people."""

import cv2
import numpy as np

from scene4d.perception.lines import straight_edges


def picture() -> np.ndarray:
    image = np.full((400, 600, 3), 90, np.uint8)
    cv2.fillPoly(
        image, [np.array([[200, 100], [320, 120], [310, 300], [190, 280]])], (200, 200, 200)
    )
    return cv2.GaussianBlur(image, (0, 0), 0.8)


def distance_to(edges: np.ndarray, a: tuple[float, float], b: tuple[float, float]) -> np.ndarray:
    """Largest distance (px) of each edge's ends from the line through a and b."""
    along = np.subtract(b, a) / np.linalg.norm(np.subtract(b, a))
    ends = edges.reshape(-1, 2, 2) - a
    return np.abs(ends[..., 0] * along[1] - ends[..., 1] * along[0]).max(axis=1)


def test_the_sides_of_a_quadrilateral_are_found():
    edges = straight_edges(picture())
    corners = [(200, 100), (320, 120), (310, 300), (190, 280)]
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        assert distance_to(edges, a, b).min() < 0.8


def test_an_empty_picture_has_none():
    assert straight_edges(np.full((200, 300, 3), 128, np.uint8)).shape == (0, 4)


def test_edges_of_people_are_left_out():
    hidden = np.array([[180.0, 90.0, 330.0, 310.0]])
    assert len(straight_edges(picture())) >= 4
    assert len(straight_edges(picture(), hidden)) == 0


def test_the_black_frame_of_an_undistorted_picture_is_no_edge():
    image = picture()
    everything = len(straight_edges(image))
    cv2.fillPoly(image, [np.array([[0, 0], [60, 0], [30, 400], [0, 400]])], (0, 0, 0))
    edges = straight_edges(image)
    assert len(edges) == everything
    assert (distance_to(edges, (60, 0), (30, 400)) > 10).all()
    # A black door inside the picture is part of the scene.
    cv2.rectangle(image, (400, 100), (470, 300), (0, 0, 0), -1)
    assert len(straight_edges(image)) >= everything + 4


def test_edges_along_the_border_are_left_out():
    image = picture()
    image[:, 3:] = image[:, :-3]
    image[:, :3] = 255
    assert (straight_edges(image)[:, [0, 2]].min(axis=1) > 6).all()
