"""Who goes behind a parked vehicle is the same when he comes out, and nobody walks on if he does
not.
"""

import numpy as np
import pytest

from scene4d.core.calibration import Calibration
from scene4d.core.people import Detections
from scene4d.store.log import Look
from scene4d.tracking._hidden import LONGEST_S, MEAN_HIDDEN_S, Hidden
from scene4d.tracking.following import follow
from walks import CAMERA, FPS, SIZE, car_box, person_box

VAN = np.array([0.0, 14.0])
BEHIND = 16.0
"""Distance of a walk that the van hides."""


def van_box(xy, drove_m=0.0):
    """A van's box: as long as a car, and 2.4 m high."""
    x1, _, x2, y2 = car_box(xy + np.array([drove_m, 0.0]))
    top = CAMERA.project(np.array([[*xy, 2.4]]))[0][0, 1]
    return np.array([x1, top, x2, y2])


def hides(person, van):
    """Whether a detector misses the person: most of the box is behind the van."""
    wide = min(person[2], van[2]) - max(person[0], van[0])
    return person[3] < van[3] and wide > 0.6 * (person[2] - person[0])


def look(path, seconds, *, seed=0, van=lambda t: 0.0, noise_px=0.7, van_missed=0.0, also=()):
    """What is seen of somebody at ``path(t)``, None for nobody, and of a van, which may be missed
    now and then. ``also`` walk too.
    """
    rng, boxes, names, frames = np.random.default_rng(seed), [], [], []
    for index in range(int(seconds * FPS)):
        time_s = index / FPS
        parked = van_box(VAN, van(time_s))
        people = [person_box(way(time_s)) for way in (path, *also) if way(time_s) is not None]
        seen = [box for box in people if not hides(box, parked)]
        vans = [parked] if rng.random() >= van_missed else []
        boxes += [*seen, *vans]
        names += ["person"] * len(seen) + ["truck"] * len(vans)
        frames += [index] * (len(seen) + len(vans))
    box, frame = np.array(boxes), np.array(frames)
    found = Detections.from_boxes(
        SIZE, frame, box + rng.normal(0, noise_px, box.shape), time_s=frame / FPS,
        class_name=np.array(names), score=np.full(len(box), 0.9),
    )  # fmt: skip
    clock = np.arange(int(seconds * FPS))
    return Look(clock, clock / FPS, found)


def tracked(*args, **options):
    """Rows of people, by track."""
    calibration = Calibration.of_camera(CAMERA)
    parts = list(follow([look(*args, **options)], calibration, 1.7, trusted=False))
    rows = [part for part in parts if len(part)]
    whole = type(rows[0]).concatenate(rows)
    people = whole.select(whole.class_name == "person")
    return [people.select(people.track == track) for track in np.unique(people.track)]


def passes(pause_s, speed=1.2, begin_m=-6.0):
    """Somebody who walks by behind the van and rests there."""

    def at(time_s):
        reach_s = -begin_m / speed
        walked_s = min(time_s, reach_s) + max(0.0, time_s - reach_s - pause_s)
        return np.array([begin_m + speed * walked_s, BEHIND])

    return at


@pytest.mark.parametrize("pause_s", [0.0, 2.0, 4.0])
def test_who_passes_behind_a_vehicle_has_one_number_and_is_bridged(pause_s):
    way = passes(pause_s)
    inside = tested = 0
    for seed in range(2):
        (one,) = tracked(way, 10.0 + pause_s, seed=seed)
        gap = one.select(~one.observed)
        assert np.ptp(gap.time_s) > 3 + pause_s
        assert np.isfinite(gap.xy_m).all()
        true = np.array([way(t) for t in gap.time_s])
        away = gap.xy_m - true
        d2 = (away * np.linalg.solve(gap.covariance_m2, away[..., None])[..., 0]).sum(axis=1)
        inside, tested = inside + (d2 < 5.99).sum(), tested + len(d2)
        sigma = np.sqrt(np.trace(gap.covariance_m2, axis1=1, axis2=2) / 2)
        assert sigma.max() > 2 * sigma[[0, -1]].max(), "least is known in the middle"
    assert inside > 0.85 * tested


def test_a_vehicle_that_is_missed_now_and_then_hides_all_the_same():
    assert len(tracked(passes(3.0), 13.0, van_missed=0.4)) == 1


def test_a_gap_is_bridged_whole_where_rows_become_final_in_its_middle():
    """Every ten seconds rows of earlier than ten seconds are final: those up to 20 s at 30 s."""
    way = passes(4.0)

    def later(time_s):
        return way(time_s - 13.0) if time_s > 13 else None

    (one,) = tracked(later, 32.0)
    gap_s = one.time_s[~one.observed]
    assert gap_s.min() < 19 < 21 < gap_s.max()
    np.testing.assert_allclose(np.diff(one.time_s), 1 / FPS, atol=1e-9)
    assert np.isfinite(one.xy_m).all()


def test_who_enters_a_vehicle_ends_where_he_was_last_seen():
    """Nobody walks on, while the van stands and after it has driven off."""
    way = passes(0.0)
    enters = lambda t: way(t) if way(t)[0] < -1.0 else None  # noqa: E731
    drives = lambda t: 3.0 * max(0.0, t - 8.0)  # noqa: E731
    (one,) = tracked(enters, 14.0, van=drives)
    assert one.observed[-1]
    assert one.time_s[-1] < 4.0
    assert one.xy_m[-1, 0] == pytest.approx(-2.5, abs=0.6)


def test_somebody_else_who_comes_long_after_is_another():
    way = passes(0.0)
    enters = lambda t: way(t) if way(t)[0] < -1.0 else None  # noqa: E731
    comes_s = 4.0 + LONGEST_S

    def other(time_s):
        return None if time_s < comes_s else np.array([2.5 + time_s - comes_s, BEHIND])

    assert len(tracked(enters, comes_s + 3, also=[other])) == 2


def test_the_hypothesis_stays_behind_and_ends_when_the_vehicle_drives_off():
    hidden, still = Hidden(CAMERA), np.diag([0.1, 0.1, 0.3, 0.3]) ** 2
    hidden.begin(7, 0.0, np.array([-2.0, BEHIND, 1.2, 0.0]), still)
    hidden.begin(8, 0.0, np.array([-9.0, BEHIND, 1.2, 0.0]), still)
    spread = []
    for time_s in np.arange(0.1, 6.0, 0.1):
        hidden.advance(time_s, van_box(VAN)[None])
        mean, covariance, probability = hidden.predicted(7, time_s)
        spread.append(np.sqrt(np.trace(covariance[:2, :2]) / 2))
    assert 8 not in hidden, "nothing hides him"
    assert abs(mean[0]) < 2.5
    assert 14.5 < mean[1] < 30
    assert spread[-1] > 2 * spread[0]
    assert 0.05 < probability < 0.5 * np.exp(-5.9 / MEAN_HIDDEN_S)
    for time_s in np.arange(6.0, 9.0, 0.1):
        hidden.advance(time_s, np.empty((0, 4)))
    assert 7 not in hidden
