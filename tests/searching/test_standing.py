"""Searches that stand: what they look at where frames were dropped."""

import numpy as np
import pytest

from made_tracks import made_tracks
from scene4d.core.tracks import Tracks
from scene4d.searching._asking import SearchOptions, words_of
from scene4d.searching.activities._events import Event
from scene4d.searching.result import FoundEvent
from scene4d.searching.standing import _settle, bridged
from scene4d.store.runs import Run

RUN = Run("r", "gate", 0, False, 0, 0, 0, {}, (), "scene4d", {})


def walk(times: np.ndarray, track: np.ndarray) -> Tracks:
    return made_tracks(
        track, times, np.column_stack([times, 2 * times]), frame=np.rint(times * 10).astype(int)
    )


def event(begin_s, end_s, person=1):
    return FoundEvent(
        Event("walk", 0.8, 0.8, float(begin_s), float(end_s), {"person": person}, {}), RUN, 0, 0
    )


def test_an_event_that_grows_and_falls_apart_is_told_once():
    """And another of the same person, later, is another."""
    query = words_of("person walks", SearchOptions(), ("gate",))[0]
    told, heard = [], []
    for now_s, events in (
        (6, [event(1, 4)]),
        (9, [event(1, 7)]),
        (10, [event(5, 7), event(1, 4)]),
        (11, [event(1, 4), event(5, 7)]),
        (16, [event(1, 4), event(9.5, 12)]),
    ):
        heard += _settle(query, told, events, float(now_s), now_s - 20.0)
    assert [(one.found.event.begin_s, one.state) for one in heard] == [
        (1, "provisional"),
        (9.5, "provisional"),
    ]
    last = _settle(query, told, [event(1, 4)], 40.0, 30.0)
    assert [(one.id, one.state) for one in last] == [
        (heard[0].id, "final"),
        (heard[1].id, "withdrawn"),
    ]


def test_rows_are_put_where_frames_were_dropped_and_nowhere_else():
    times = np.array([0.0, 0.2, 1.2, 1.4, 5.0, 0.0, 0.4])
    tracks = walk(times, np.array([1, 1, 1, 1, 1, 2, 2]))
    every = bridged(tracks, 0.2)
    one = every.select(every.track == 1)
    assert one.time_s == pytest.approx([0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 5.0])
    assert one.observed.tolist() == [True, True, *[False] * 4, True, True, True]
    np.testing.assert_allclose(one.xy_m, np.column_stack([one.time_s, 2 * one.time_s]))
    assert np.isnan(one.box_xyxy[2:6]).all()
    assert every.time_s[every.track == 2] == pytest.approx([0, 0.2, 0.4])
    whole = walk(np.arange(5) * 0.2, np.ones(5, int))
    assert bridged(whole, 0.2) is whole
