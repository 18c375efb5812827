"""One number for one person: where several saw him, never for two, and as sure as told."""

from dataclasses import replace
from functools import cache
from itertools import permutations

import numpy as np
import pytest

from scene4d.alignment import _identity
from scene4d.alignment._identity import identified, passages_of
from scene4d.alignment._marginals import all_of, marginals, named
from scene4d.core.colours import CLOTHES, PALETTE, log_likelihood
from scene4d.core.tracks import Tracks
from scene4d.store.identities import Identities
from scene4d.store.regrounding import in_site
from site_worlds import Eye, Walker, place, seen, strolls

WEST = Eye("west", place(0, 0, 0), (-6, 0), 12.0, 0.1, 0.15)
EAST = Eye("east", place(20, 5, 120, 1.0, 5.0), (6, 0), 12.0, 0.15, 0.2)
NORTH = Eye("north", place(-8, 9, -70, 1.0, -3.0), (0, 8), 12.0, 0.15, 0.2)
APART = [
    replace(WEST, middle_m=(-11, 0), radius_m=9.0),
    replace(EAST, middle_m=(11, 0), radius_m=9.0),
]


def looked(eyes, walkers, seed=0, breaks=0.03):
    """What the cameras saw, and whose track each is, by camera."""
    passages, whose = [], {}
    for eye in eyes:
        tracks, whose[eye.name] = seen(eye, walkers, seed, breaks)
        tracks = in_site(tracks, eye.placement)
        passages.append(passages_of(eye.name, tracks))
    return passages, whose


def owners(found: Identities, whose) -> np.ndarray:
    rows = zip(found.camera.tolist(), found.track.tolist(), strict=True)
    return np.array([whose[camera][track] for camera, track in rows])


def judged(found: Identities, whose) -> tuple[int, int, int]:
    """Pairs of tracks of two cameras: rightly one, wrongly one, wrongly two."""
    who = owners(found, whose)
    i, j = np.triu_indices(len(who), 1)
    across = found.camera[i] != found.camera[j]
    same, said = (who[i] == who[j])[across], (found.identity[i] == found.identity[j])[across]
    return int((same & said).sum()), int((said & ~same).sum()), int((same & ~said).sum())


def test_who_is_seen_by_several_has_one_number_and_strangers_have_two():
    right = wrong = missed = 0
    for seed in range(3):
        passages, whose = looked([WEST, EAST, NORTH], strolls(40, 180.0, 12.0, seed), seed)
        r, w, m = judged(identified(passages), whose)
        right, wrong, missed = right + r, wrong + w, missed + m
    assert right > 350
    assert wrong < 0.03 * right and missed < 0.15 * right


def test_nobody_is_in_two_places_at_once():
    passages, _ = looked([WEST, EAST, NORTH], strolls(50, 90.0, 8.0))
    found = identified(passages)
    assert sorted(np.unique(found.identity)) == list(range(1, found.identity.max() + 1))
    assert len(found) == sum(map(len, passages))
    for one in passages:
        of = found.identity[found.camera == one.camera]
        for number in np.unique(of):
            rows = np.flatnonzero(of == number)
            rows = rows[np.argsort(one.begin[rows])]
            assert (one.begin[rows][1:] - one.end[rows][:-1] > -2).all()


def dressed(passages, whose, seed, wrong=()):
    """The same in clothes of their own, as each camera names them; ``wrong`` ones show them red as
    purple and white as pink.
    """
    rng, people, out = np.random.default_rng([seed, 7]), {}, []
    for one in passages:
        cast = np.array([0, 22, -25]) if one.camera in wrong else rng.normal(0, 3.0, 3)
        rows = []
        for track in one.track.tolist():
            who = whose[one.camera][track]
            if who not in people:
                entries = rng.choice(len(PALETTE), 2, p=CLOTHES)
                people[who] = np.array([typical(e) for e in entries]) + rng.normal(0, 4, (2, 3))
            lab = people[who] + rng.normal(0, [7, 4, 4], (2, 3)) + cast
            log = log_likelihood(lab, np.full(2, 3.0)) + np.log(CLOTHES)
            p = np.exp(log - log.max(axis=1, keepdims=True))
            rows.append((p / p.sum(axis=1, keepdims=True)).ravel())
        out.append(replace(one, colours=np.array(rows)))
    return out


@cache
def typical(entry: int) -> np.ndarray:
    """A colour that is called so, found among all."""
    grid = np.stack(np.meshgrid(*map(np.arange, (8, -40, -50), (98, 60, 70), (8, 8, 8))), axis=-1)
    lab = grid.reshape(-1, 3).astype(float)
    return lab[int(log_likelihood(lab, np.zeros(len(lab)))[:, entry].argmax())]


def across_gaps(monkeypatch, sites) -> tuple[np.ndarray, np.ndarray]:
    """Probabilities of pairs across gaps, and whether they are one."""
    said, true = [], []
    across = _identity._across_gaps

    def noted(later, chains):
        joins = across(later, chains)
        said.append(joins.probability)
        true.append(who[joins.a] == who[joins.b])
        return joins

    with monkeypatch.context() as patch:
        patch.setattr(_identity, "_across_gaps", noted)
        for passages, whose in sites:
            who = np.array(
                [whose[one.camera][track] for one in passages for track in one.track.tolist()]
            )
            identified(passages)
    return np.concatenate(said), np.concatenate(true)


def test_across_a_gap_probabilities_come_true_and_colours_make_them_surer(monkeypatch):
    """As often as they say within what 300 cases tell, and never far too sure: without colours,
    with them, and with those of a camera whose white balance is wrong.
    """
    sites = [looked(APART, strolls(40, 180.0, 8.0, seed), seed) for seed in range(12)]
    score = {}
    for how in ("none", "right", "wrong"):
        wrong = ("east",) if how == "wrong" else ()
        some = sites
        if how != "none":
            some = [(dressed(p, whose, k, wrong), whose) for k, (p, whose) in enumerate(sites)]
        p, y = across_gaps(monkeypatch, some)
        check_calibrated(p, y)
        score[how] = np.log(np.where(y, p, 1 - p).clip(1e-4)).sum()
    assert 0.7 < score["right"] / score["none"] < 0.97
    assert 0.85 < score["wrong"] / score["none"] < 1.05


def check_calibrated(p: np.ndarray, y: np.ndarray) -> None:
    sure, unsure, hardly = p > 0.9, (p > 0.3) & (p < 0.8), p < 0.1
    assert sure.sum() > 60 and y[sure].mean() > 0.95
    assert unsure.sum() > 40 and 0.3 < y[unsure].mean() < 0.95
    assert y[hardly].mean() < 0.05
    assert (p[y.astype(bool)] > 0.5).mean() > 0.5


def test_two_who_walk_side_by_side_keep_their_own_numbers():
    """0.7 m apart, and one of them is not seen by the second camera at all."""
    one = strolls(1, 60.0, 2.0, 4)[0]
    turned = np.gradient(one.xy_m, axis=0)[:, ::-1] * [-1, 1]
    beside = one.xy_m + 0.7 * turned / np.linalg.norm(turned, axis=1, keepdims=True)
    pair = [one, Walker(one.time_s, beside)]
    eyes = [replace(WEST, shared_m=0.05), replace(EAST, shared_m=0.05)]
    for seed in range(5):
        passages, whose = looked(eyes, pair, seed, 0.0)
        assert judged(identified(passages), whose)[1:] == (0, 0)


def test_people_and_vehicles_are_never_one():
    one = strolls(1, 60.0, 2.0, 4)[0]
    passages, _ = looked([WEST], [one], breaks=0.0)
    others, _ = looked([EAST], [replace(one, kind="car")], breaks=0.0)
    found = identified(passages + others)
    assert len(np.unique(found.identity)) == len(found)
    cars, _ = looked([WEST], [replace(one, kind="truck")], breaks=0.0)
    assert len(np.unique(identified(cars + others).identity)) < len(cars[0]) + len(others[0])


def test_heights_tell_people_apart_where_places_do_not():
    """A tall and a small one go side by side, out of one view and then into another."""
    time_s = np.arange(0, 30, 0.1)
    rng = np.random.default_rng(0)
    total = np.zeros(3, int)
    for seed in range(12):
        x = np.interp(time_s, [0, 30], [-15, 15])
        y = np.cumsum(rng.normal(0, 0.03, (2, len(x))), axis=1)
        tall = Walker(time_s, np.column_stack([x, y[0]]), height_m=1.95)
        small = Walker(time_s, np.column_stack([x, y[1]]), height_m=1.55)
        passages, whose = looked(APART, [tall, small], seed, 0.0)
        total += judged(identified(passages), whose)
    assert total[0] >= 18 and total[1] <= 1


def test_what_nobody_or_one_camera_saw_is_no_trouble():
    passages, _ = looked([WEST], strolls(3, 60.0, 4.0))
    assert len(np.unique(identified(passages).identity)) <= len(passages[0])
    nothing = passages_of("empty", Tracks.concatenate([passages[0].rows]).select(np.zeros(0, int)))
    found = identified([*passages, nothing])
    assert len(found) == len(passages[0]) and (found.probability <= 1).all()


def counted(odds: np.ndarray) -> np.ndarray:
    """Probabilities of all pairs, by counting all ways of pairing rows with columns or nobody."""
    n, m = odds.shape
    weight, total = np.zeros_like(odds), 0.0
    slots = [*range(m), *[-1] * n]
    for way in set(permutations(slots, n)):
        value = np.prod([odds[i, j] for i, j in enumerate(way) if j >= 0])
        total += value
        for i, j in enumerate(way):
            if j >= 0:
                weight[i, j] += value
    return weight / total


@pytest.mark.parametrize("seed", range(6))
def test_marginals_are_those_of_all_pairings_counted_out(seed):
    odds = np.exp(np.random.default_rng(seed).normal(0, 2.5, (3, 3)))
    i, j = (index.ravel() for index in np.indices(odds.shape))
    same_row = np.argwhere((i[:, None] == i) & (j[:, None] != j))
    same_column = np.argwhere((j[:, None] == j) & (i[:, None] != i))
    listed = named(9, same_row), named(9, same_column)
    found = marginals(np.log(odds).ravel(), *listed).reshape(odds.shape)
    np.testing.assert_allclose(found, counted(odds), atol=0.1)
    shared = marginals(np.log(odds).ravel(), all_of(i), all_of(j)).reshape(odds.shape)
    np.testing.assert_allclose(shared, found, atol=1e-12)
    alone = marginals(np.log(odds).ravel(), named(9, same_row[:0]), named(9, same_column[:0]))
    np.testing.assert_allclose(alone, (odds / (1 + odds)).ravel())
