"""Sampling: distinct, ordered, even frames, and few that are decoded for nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.video import _videofile as videofile
from scene4d.video import sampling
from scene4d.video.frames import Timeline
from scene4d.video.reader import open_source
from scene4d.video.sampling import choose_frames, sample_frames, spread
from scene4d.video.stream import StreamSource

LONG = (1000, 1000)  # a size of frames that makes a few thousand of them "long"


def timeline(count: int, gop: int, fps: float = 25.0) -> Timeline:
    return Timeline(np.arange(count) / fps, np.arange(count) % gop == 0)


def decoded(clip: Timeline, chosen: np.ndarray) -> int:
    """How many frames a decoder works through for these."""
    position, total = -1, 0
    for i in chosen:
        start = max(position + 1, int(clip.key_before[i]))
        total += i - start + 1
        position = i
    return total


@given(st.lists(st.floats(0.001, 50), min_size=1, max_size=80), st.data())
def test_spread_gives_distinct_ordered_positions_inside(steps, data):
    times = np.cumsum(steps)
    n = data.draw(st.integers(1, len(times)))
    chosen = spread(times, n)
    assert len(chosen) == n
    assert (np.diff(chosen) > 0).all()
    assert chosen[0] >= 0
    assert chosen[-1] < len(times)


@given(st.integers(2, 60), st.integers(2, 20))
def test_spread_of_even_times_is_even(n, times_n):
    chosen = spread(np.arange(n * times_n, dtype=float), n)
    assert np.abs(np.diff(chosen) - times_n).max() <= 1
    assert abs(chosen[0] - (times_n - 1) / 2) <= 1
    assert abs(chosen[-1] - (n * times_n - 1 - (times_n - 1) / 2)) <= 1


def test_spread_takes_the_nearest_in_time_where_the_rate_varies():
    times = np.concatenate([np.linspace(0, 10, 1001), np.linspace(11, 110, 100)])
    chosen = spread(times, 11)
    assert np.abs(times[chosen] - np.linspace(5, 105, 11)).max() <= 0.5


@given(st.integers(1, 4000), st.integers(1, 400), st.integers(1, 300))
def test_chosen_frames_are_distinct_ordered_and_inside(count, gop, n):
    clip = timeline(count, gop)
    for image_size in ((1, 1), LONG):
        chosen = choose_frames(clip, n, image_size)
        assert len(chosen) == min(n, count)
        assert (np.diff(chosen) > 0).all()
        assert set(chosen) <= set(range(count))


def test_a_short_clip_is_sampled_exactly_evenly():
    chosen = choose_frames(timeline(795, 250), 100, (768, 576))
    assert set(np.diff(chosen)) <= {7, 8, 9}


def test_a_long_clip_with_enough_key_frames_gives_key_frames_only():
    clip = timeline(15_000, 50)
    chosen = choose_frames(clip, 100, LONG)
    assert clip.is_key[chosen].all()
    assert set(np.diff(chosen)) == {150}


def test_a_long_clip_with_few_key_frames_decodes_little_and_still_spreads():
    clip = timeline(15_000, 250)
    chosen = choose_frames(clip, 100, LONG)
    assert decoded(clip, chosen) < 15_000 / 5
    gaps = np.diff(chosen)
    assert gaps.min() >= 25  # a second: another pose
    assert gaps.max() <= 500  # never more than two groups


def test_without_a_wish_one_frame_a_second_within_limits():
    for seconds, expected in [(3, 75), (79, 100), (150, 150), (3600, 200)]:
        clip = timeline(seconds * 25, 10)
        assert len(choose_frames(clip, None, LONG)) == expected


def test_the_decoder_is_fed_few_packets_of_a_long_video(write_video, read_stamp, monkeypatch):
    source = open_source(write_video("long.mp4", 1500, gop=100))
    monkeypatch.setattr(sampling, "STRAIGHT_PIXELS", 0)
    fed = []
    decode = videofile.decode
    monkeypatch.setattr(videofile, "decode", lambda s, p: fed.append(p) or decode(s, p))
    frames = list(sample_frames(source, 15))
    assert [f.index for f in frames] == list(range(0, 1500, 100))
    assert [read_stamp(f.image_bgr) for f in frames] == list(range(0, 1500, 100))
    assert len(fed) <= 2 * 15  # each key frame, and one call to get it out
    assert source.warnings == ()


def test_no_frames_are_no_wish(write_video):
    with pytest.raises(InputError, match="at least 1, found 0"):
        sample_frames(open_source(write_video("a.mp4", 10)), 0)


def test_images_are_sampled_by_rank(tmp_path):
    import cv2

    for i in range(12):
        cv2.imwrite(str(tmp_path / f"{i}.png"), np.zeros((8, 8), np.uint8))
    source = open_source(tmp_path)
    assert [f.index for f in sample_frames(source, 3)] == [2, 5, 9]
    assert len(list(sample_frames(source))) == 12


def test_a_stream_gives_a_frame_a_second_as_they_come(write_video, read_stamp):
    with StreamSource(str(write_video("a.mkv", 130))) as stream:
        frames = list(sample_frames(stream, 4))
    assert [read_stamp(f.image_bgr) for f in frames] == [0, 25, 50, 75]


def test_the_pets_video_by_default(shared_data):
    source = open_source(shared_data / "pets2009" / "vtest.avi")
    frames = list(sample_frames(source))
    assert len(frames) == 100
    assert [f.time_s for f in frames] == pytest.approx([f.index / 10 for f in frames])
