"""A site over the lines of a map: right, as well as it says, or a reason why not."""

import numpy as np
import pytest

from alignment.maps import MAIN, STREETS, lines, tie, traffic, truth
from scene4d.alignment._anchors import Anchored
from scene4d.alignment._lines import on_lines
from scene4d.core.calibration import Calibration
from scene4d.core.placement import Placement
from scene4d.core.tracks import Tracks
from scene4d.formats.anchors import Anchors
from site_worlds import CAMERA, place

WEST = np.array([[-50.0, 0.0], [50.0, 0.0]])
SOUTH = np.array([[0.0, -50.0], [0.0, 50.0]])
KNOWN = Calibration.of_camera(CAMERA)


def put(seen: Tracks, on, shared=None) -> Placement:
    return on_lines([seen], [np.zeros((len(seen), 2, 0)) if shared is None else shared], on)


def step(found: Placement, true: Placement) -> np.ndarray:
    apart = (found.parameters - true.parameters)[:4]
    apart[2] = np.angle(np.exp(1j * apart[2]))
    return apart


def test_tracks_find_their_streets_as_well_as_they_say():
    """Four of ten lanes a street's middle, a sixth of the tracks across country, the map off by a
    metre as a whole.
    """
    squares, inside = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        true = truth(rng)
        seen, off = traffic(rng, true, count=15), rng.normal(0, 1, 2)
        found = put(seen, lines(*(street + off for street in STREETS)))
        z = step(found, true) / np.sqrt(np.diag(found.covariance)[:4])
        squares.append(z**2)
        inside.append(np.abs(z) < 1.96)
    assert 0.4 < np.mean(squares) < 1.8
    assert np.mean(inside) >= 0.85
    sigma = found.sigma
    assert sigma["x_m"] < 1.5 and sigma["heading_rad"] < 0.02 and sigma["scale"] < 0.03


def test_what_cameras_err_by_together_is_in_the_covariance():
    """A metre to the side for all rows is a metre for the frame, however many tracks there are."""
    rng = np.random.default_rng(1)
    seen = traffic(rng, truth(rng))
    alone = put(seen, lines())
    shared = np.zeros((len(seen), 2, 1))
    shared[:, 0] = 2.0
    together = put(seen, lines(), shared)
    more = np.linalg.eigvalsh(together.covariance[:2, :2] - alone.covariance[:2, :2])
    np.testing.assert_allclose(more, [0.0, 4.0 * alone.scale**2], atol=0.1)


@pytest.mark.parametrize(
    ("streets", "word"),
    [
        ((WEST,), "slides along the lines"),
        ((WEST, SOUTH), "as well turned by"),
    ],
)
def test_what_the_lines_leave_open_is_told(streets, word):
    rng = np.random.default_rng(2)
    seen = traffic(rng, place(5.0, 8.0, 30.0), streets, strays=0.0)
    found = put(seen, lines(*streets))
    assert not found
    assert word in found.reason


def test_lines_that_nobody_keeps_to_are_told():
    rng = np.random.default_rng(3)
    across = traffic(rng, truth(rng), strays=1.0, count=20)
    assert "of the ways lie along lines" in put(across, lines()).reason
    seen = traffic(rng, truth(rng), count=5)
    assert "nobody walks or drives" in put(seen, lines(kinds=(0,))).reason
    assert "nobody walks or drives" in put(seen.select(np.zeros(0, int)), lines()).reason


def test_people_keep_to_pavements_and_cars_to_roads():
    """Pavements that run elsewhere do not pull the cars; people on lawns do not either."""
    rng = np.random.default_rng(4)
    true = truth(rng)
    cars = traffic(rng, true, count=15)
    walkers = traffic(rng, true, count=6, strays=1.0, kind="person")
    pavement = lines(MAIN[:, ::-1], kinds=(0,))
    found = on_lines(
        [cars, walkers], [np.zeros((len(one), 2, 0)) for one in (cars, walkers)],
        (*lines(kinds=(1,)), *pavement),
    )  # fmt: skip
    assert found, found.reason
    assert np.hypot(*step(found, true)[:2]) < 3.0


def test_a_site_is_moved_onto_the_map_whole():
    rng = np.random.default_rng(5)
    true = truth(rng)
    inner = place(12.0, 20.0, 160.0, 1.0, 3.0)
    seen = {"west": traffic(rng, true), "east": traffic(rng, inner.then(true))}
    cameras = {
        "west": Anchored(KNOWN, place(0.0, 0.0, 0.0), seen["west"], True),
        "east": Anchored(KNOWN, inner, seen["east"], True),
        "alone": Anchored(KNOWN, Placement.undetermined("shares nobody"), seen["west"], True),
        "blind": Anchored(KNOWN, Placement.undetermined("shares nobody"), None, True),
    }
    on_map = Anchors("earth", lines=lines(), latitude_deg=53.0, longitude_deg=-1.0)
    found, anchor, _ = tie(cameras, on_map)
    assert anchor and anchor.latitude_deg == 53.0
    for name, expected in {"west": true, "east": inner.then(true), "alone": true}.items():
        z = step(found[name], expected) / np.sqrt(np.diag(found[name].covariance)[:4])
        assert np.abs(z).max() < 3.5, name
    assert found["east"].time_offset_s == 3.0
    assert not found["blind"]
    straight = Anchors("earth", lines=lines(WEST), latitude_deg=53.0, longitude_deg=-1.0)
    cameras = {"west": Anchored(KNOWN, inner, traffic(rng, true, (WEST,)), True)}
    same, anchor, _ = tie(cameras, straight)
    assert not anchor and "slides" in anchor.reason
    assert same["west"] is inner
