"""Video files: the right frame under the right number at the right time, whatever the file."""

import gc
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from scene4d.core.errors import InputError, UnavailableError
from scene4d.video import _videofile as videofile
from scene4d.video._timeline import _from_packets
from scene4d.video.reader import open_source
from scene4d.video.stream import StreamSource, stream_name, without_password

FORMATS = [
    ("a.mp4", {}),
    ("a.mkv", {}),
    ("a.ts", {}),
    ("a.mov", {"b_frames": 0}),
    ("mpeg4.avi", {"codec": "mpeg4"}),
    ("intra.avi", {"codec": "mjpeg", "b_frames": 0}),
    ("ordered.avi", {"b_frames": 0}),
    ("reordered.avi", {}),
    ("open_gop.mpg", {"codec": "mpeg2video"}),
    ("raw.h264", {}),
    ("hevc.mp4", {"codec": "libx265"}),
    ("av1.mp4", {"codec": "libsvtav1"}),
    ("vp9.webm", {"codec": "libvpx-vp9"}),
]


@pytest.mark.parametrize(("name", "options"), FORMATS, ids=[f[0] for f in FORMATS])
def test_every_frame_comes_once_under_its_number(write_video, read_stamp, name, options):
    with open_source(write_video(name, **options)) as source:
        frames = list(source.frames())
        assert source.image_size == (160, 128)
        assert source.frame_count == 60
        assert source.fps == pytest.approx(25, rel=1e-3)
        assert source.duration_s == pytest.approx(60 / 25, rel=1e-3)
    assert [f.index for f in frames] == list(range(60))
    assert [read_stamp(f.image_bgr) for f in frames] == list(range(60))
    assert np.allclose([f.time_s for f in frames], np.arange(60) / 25, atol=1e-3)
    below = frames[30].image_bgr[100, 80].astype(int)
    assert np.abs(below - (200, 40, 40)).max() < 12, "BGR order"


@pytest.mark.parametrize(("name", "options"), FORMATS, ids=[f[0] for f in FORMATS])
def test_wanted_frames_are_exact_after_seeking(write_video, read_stamp, name, options):
    source = open_source(write_video(name, 150, **options))
    wanted = [0, 3, 39, 40, 41, 58, 77, 100, 101, 119, 120, 149]
    frames = list(source.frames(reversed(wanted)))
    assert [f.index for f in frames] == wanted
    assert [read_stamp(f.image_bgr) for f in frames] == wanted
    assert not [w for w in source.warnings if "damaged" in w]


def test_no_frame_of_a_long_av1_group_is_lost(write_video, read_stamp):
    source = open_source(write_video("a.mp4", 150, codec="libsvtav1", gop=64))
    for wanted in ([5, 40, 77, 149], range(3, 150)):
        assert [read_stamp(f.image_bgr) for f in source.frames(wanted)] == list(wanted)
    assert source.warnings == ()


@pytest.mark.parametrize("b_frames", [0, 2])
@pytest.mark.parametrize("name", ["vfr.mp4", "vfr.mkv"])
def test_variable_rate_keeps_the_containers_times(write_video, read_stamp, name, b_frames):
    rng = np.random.default_rng(1)
    times_ms = 500 + np.cumsum(rng.integers(15, 400, 80))
    source = open_source(write_video(name, 80, times_ms=times_ms, b_frames=b_frames))
    frames = list(source.frames([5, 30, 79]))
    assert [read_stamp(f.image_bgr) for f in frames] == [5, 30, 79]
    expected = (times_ms[[5, 30, 79]] - times_ms[0]) / 1000
    assert np.allclose([f.time_s for f in frames], expected, atol=2e-3)
    assert source.fps == pytest.approx(79_000 / (times_ms[-1] - times_ms[0]), rel=1e-3)


def test_the_index_and_the_packets_tell_the_same_times(write_video):
    import av

    source = open_source(write_video("plain.mp4", 70, b_frames=0))
    with av.open(source.name) as container:
        table = _from_packets(container, container.streams.video[0])
    assert np.array_equal(table.pts, source._pts)
    assert np.array_equal(table.is_key, source.timeline.is_key)
    assert np.flatnonzero(table.is_key).tolist() == [0, 20, 40, 60]


# ISO 14496-12, 8.3.2 by way of FFmpeg: a display rotation turns counter-clockwise, and mirrors
# after it. OpenCV's VideoCapture is no reference here: 4.11 leaves out every turn.
TURNS = {90: cv2.ROTATE_90_COUNTERCLOCKWISE, 180: cv2.ROTATE_180, -90: cv2.ROTATE_90_CLOCKWISE}


@pytest.mark.parametrize(("hflip", "vflip"), [(False, False), (True, False), (False, True)])
@pytest.mark.parametrize("degrees", [0, 90, 180, -90])
def test_the_display_matrix_turns_and_mirrors_the_picture(write_video, degrees, hflip, vflip):
    upright = next(open_source(write_video("upright.mp4", 3)).frames()).image_bgr
    source = open_source(write_video("turned.mp4", 3, turned=(degrees, hflip, vflip)))
    image = next(source.frames()).image_bgr
    reference = cv2.rotate(upright, TURNS[degrees]) if degrees else upright
    if hflip or vflip:
        reference = cv2.flip(reference, 1 if hflip else 0)
    assert source.image_size == image.shape[1::-1] == reference.shape[1::-1]
    assert np.abs(image.astype(int) - reference).max() <= 3
    assert image.flags.c_contiguous


def test_a_slanting_display_matrix_is_refused(write_video):
    with pytest.raises(InputError, match=r"turns the picture by (29|30) degrees"):
        open_source(write_video("slanting.mp4", 3, turned=(30, False, False)))


def test_two_iterators_of_one_source_do_not_disturb_each_other(write_video, read_stamp):
    source = open_source(write_video("a.mp4"))
    for a, b in zip(source.frames(), source.frames([10, 40, 50]), strict=False):
        assert read_stamp(a.image_bgr) == a.index
        assert read_stamp(b.image_bgr) == b.index


@pytest.mark.parametrize("indices", [[-1], [0, 60]])
def test_a_frame_that_does_not_exist(write_video, indices):
    source = open_source(write_video("a.mp4"))
    with pytest.raises(InputError, match=r"has no frame (-1|60); its frames are 0 to 59"):
        list(source.frames(indices))


def cut(path: Path, share: float) -> Path:
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    return path


@pytest.mark.parametrize("name", ["a.mkv", "b.avi", "fast.mp4"])
def test_a_truncated_file_gives_what_decodes_and_says_how_much_is_missing(
    write_video, read_stamp, name
):
    codec = "mpeg4" if name.endswith("avi") else "libx264"
    flags = {"movflags": "faststart"} if name.endswith("mp4") else None
    source = open_source(cut(write_video(name, 100, codec=codec, container=flags), 0.6))
    frames = list(source.frames())
    assert 20 < len(frames) < 95
    # Around the cut, frames that are shown earlier may be gone: the last ranks say nothing.
    sure = frames[:-3]
    assert [read_stamp(f.image_bgr) for f in sure] == [f.index for f in sure]
    assert f"{source.frame_count} of 100 frames are there" in source.warnings[0]
    lost = source.frame_count - len(frames)
    if lost:
        assert f"{lost} of the {source.frame_count} frames asked for are damaged" in "".join(
            source.warnings
        )


def test_a_truncated_mp4_without_its_index_names_the_cause(write_video):
    with pytest.raises(InputError, match=r"a\.mp4: .*index is missing because .* cut off"):
        open_source(cut(write_video("a.mp4"), 0.6))


def overwritten(path: Path, at: float, count: int) -> Path:
    data = bytearray(path.read_bytes())
    middle = int(len(data) * at)
    data[middle : middle + count] = np.random.default_rng(0).bytes(count)
    path.write_bytes(data)
    return path


def test_damage_in_the_middle_costs_only_frames(write_video, read_stamp):
    path = write_video("a.mp4", 100, b_frames=0)
    source = open_source(overwritten(path, 0.4, 900))
    assert source.warnings == ()
    frames = list(source.frames())
    lost = 100 - len(frames)
    assert 0 < lost < 60
    assert f"{lost} of the 100 frames asked for are damaged" in source.warnings[0]
    late = [f for f in frames if f.index >= 80]
    assert [read_stamp(f.image_bgr) for f in late] == list(range(80, 100))


@pytest.mark.parametrize(
    ("name", "codec", "sound"),
    [("a.mkv", "libx264", False), ("a.mkv", "libx264", True), ("a.webm", "libvpx-vp9", False)],
)
def test_frames_that_damage_hides_from_the_container_are_counted(write_video, name, codec, sound):
    path = write_video(name, 60, codec=codec, sound=sound)
    source = open_source(overwritten(path, 0.3, 900))
    assert source.frame_count < 40
    assert f"{source.frame_count} of 60 frames are there" in source.warnings[0]


def test_a_recording_of_varying_rate_lacks_nothing(write_video):
    times_ms = np.cumsum(np.random.default_rng(3).integers(20, 400, 60))
    assert open_source(write_video("a.mkv", 60, times_ms=times_ms)).warnings == ()


def test_a_paused_recording_of_constant_rate_is_noted(write_video):
    times_ms = 40 * np.r_[0:30, 50:80]
    source = open_source(write_video("a.mkv", 60, times_ms=times_ms))
    assert "60 of 80 frames are there" in source.warnings[0]


@pytest.mark.parametrize("b_frames", [0, 2])
@pytest.mark.parametrize("wanted", [None, [30]])
def test_frames_behind_damage_are_under_suspicion(write_video, b_frames, wanted):
    path = write_video("a.mp4", 100, b_frames=b_frames)
    source = open_source(overwritten(path, 0.3, 20))
    list(source.frames(wanted))
    assert "damaged behind 1 of its 5 key frames; frames there may show" in source.warnings[-1]


def test_all_wanted_frames_damaged_is_an_error(write_video, monkeypatch):
    source = open_source(write_video("a.mp4"))
    monkeypatch.setattr(videofile, "decode", lambda stream, packet: ([], False))
    with pytest.raises(InputError, match="none of 2 frames can be decoded"):
        list(source.frames([3, 7]))


def test_frames_of_changing_size(write_video, tmp_path):
    parts = [
        write_video(f"{w}.ts", 10, codec="mpeg2video", b_frames=0, size=(w, 128))
        for w in (160, 192)
    ]
    path = tmp_path / "joined.ts"
    path.write_bytes(b"".join(p.read_bytes() for p in parts))
    source = open_source(path)
    with pytest.raises(InputError, match=r"joined\.ts: frame \d+ is 192x128 .* 160x128"):
        list(source.frames())


def test_joined_recordings_whose_clock_jumps_back_are_counted(write_video, read_stamp, tmp_path):
    part = write_video("part.ts", 30, codec="mpeg2video", b_frames=0).read_bytes()
    path = tmp_path / "joined.ts"
    path.write_bytes(part + part)
    source = open_source(path)
    assert "no usable times; 25 frames a second are assumed" in source.warnings[0]
    frames = list(source.frames([4, 40]))
    assert [f.index for f in frames] == [4, 40]
    assert [f.time_s for f in frames] == [4 / 25, 40 / 25]
    assert read_stamp(frames[0].image_bgr) == 4


def test_what_is_no_video(tmp_path):
    text = tmp_path / "notes.txt"  # FFmpeg alone would show this as a terminal
    text.write_text("not a video\n" * 100)
    fake = tmp_path / "fake.mp4"
    fake.write_text("not a video\n" * 100)
    empty = tmp_path / "empty.avi"
    empty.touch()
    for path, message in [
        (text, r"notes\.txt: holds no video"),
        (fake, r"fake\.mp4: is not a video that can be read"),
        (empty, r"empty\.avi: is empty \(0 bytes\); copy or record it again"),
        (tmp_path / "absent.mp4", r"absent\.mp4: cannot be read: No such file"),
    ]:
        with pytest.raises(InputError, match=message):
            open_source(path)


def test_an_unknown_codec_is_named(write_video):
    path = write_video("a.avi", codec="mpeg4")
    path.write_bytes(path.read_bytes().replace(b"FMP4", b"ZQ9Z"))
    with pytest.raises(InputError, match=r"a\.avi: its video codec is unknown"):
        open_source(path)


@pytest.mark.parametrize("size", [(9000, 2), (32_768, 16)])
def test_a_video_too_flat_or_too_wide_is_refused(write_video, size):
    with pytest.raises(InputError, match=f"found a picture of {size[0]}x{size[1]} pixels"):
        open_source(write_video("a.mkv", 1, codec="ffv1", size=size))


def test_the_pets_video(shared_data):
    source = open_source(shared_data / "pets2009" / "vtest.avi")
    assert (source.image_size, source.frame_count, source.fps) == ((768, 576), 795, 10)
    assert source.duration_s == pytest.approx(79.5)
    wanted = [0, 249, 250, 600, 794]
    frames = list(source.frames(wanted))
    assert [f.time_s for f in frames] == pytest.approx([i / 10 for i in wanted])
    capture = cv2.VideoCapture(source.name)
    for i in range(250):  # independent: OpenCV, decoded straight through
        capture.grab()
        if i == 249:
            reference = capture.retrieve()[1]
    assert np.abs(frames[1].image_bgr.astype(int) - reference).mean() < 1
    assert source.warnings == ()


def test_stream_frames_come_in_order_with_their_own_clock(write_video, read_stamp):
    times_ms = 1000 + np.cumsum(np.random.default_rng(2).integers(20, 90, 40))
    with StreamSource(str(write_video("a.mkv", 40, times_ms=times_ms))) as stream:
        assert stream.frame_count is None
        assert stream.duration_s is None
        assert stream.image_size == (160, 128)
        first = list(stream.frames([2, 7]))
        second = list(stream.frames([1, 9, 70]))
    assert [f.index for f in first + second] == [2, 7, 9]
    assert [read_stamp(f.image_bgr) for f in first + second] == [2, 7, 9]
    expected = (times_ms[[2, 7, 9]] - times_ms[0]) / 1000
    assert np.allclose([f.time_s for f in first + second], expected, atol=2e-3)
    assert "ended before" in stream.warnings[0]


class Lossy:
    """A container whose connection breaks after some packets."""

    def __init__(self, container, packets):
        self.container, self.left = container, packets

    def __getattr__(self, name):
        return getattr(self.container, name)

    def demux(self, stream):
        import av

        for packet in self.container.demux(stream):
            self.left -= 1
            if self.left < 0:
                raise av.error.TimeoutError(110, "Connection timed out")
            yield packet


def test_a_lost_stream_says_so_and_when(write_video, monkeypatch):
    import av

    path, opened = str(write_video("a.mkv", 60, b_frames=0)), av.open
    monkeypatch.setattr(av, "open", lambda *a, **k: Lossy(opened(*a, **k), 40))
    with StreamSource(path) as stream:
        count = len(list(stream.frames()))
    assert 20 < count <= 40
    (warning,) = stream.warnings
    assert f"was lost (Connection timed out) after {(count - 1) / 25:.1f} s" in warning


def test_a_stream_that_ends_says_so_and_a_recording_that_ends_does_not(write_video):
    with StreamSource(str(write_video("a.mkv", 30))) as recording:
        assert len(list(recording.frames())) == 30
    assert recording.warnings == ()
    with StreamSource(str(write_video("live.ts", 30, codec="mpeg2video"))) as live:
        live._container = Lossy(live._container, 1000)
        live._stated_s = 0.0
        list(live.frames())
    assert "the stream ended after 1." in live.warnings[0]


@pytest.mark.parametrize("url", ["rtsp://u:secret@cam/1", "HTTP://u:secret@host/live.m3u8"])
def test_stream_addresses_go_to_the_stream_reader_and_hide_the_password(monkeypatch, url):
    import av

    asked = []

    def refuse(address, **options):
        asked.append((address, options))
        raise av.error.TimeoutError(110, "Connection timed out")

    monkeypatch.setattr(av, "open", refuse)
    with pytest.raises(UnavailableError, match="cannot be opened") as caught:
        open_source(url)
    assert asked[0][0] == url
    assert asked[0][1]["timeout"] > 0
    assert "secret" not in str(caught.value)
    assert "secret" not in without_password(url)


@pytest.mark.parametrize(
    "url",
    [
        "rtsp://user:se@cret@host/a",
        "rtsp://host/user=admin&password=se@cret&channel=1",
        "http://host/x?user=a&pwd=se@cret",
        "http://host/x?token=se@cret",
    ],
)
def test_no_part_of_a_password_is_shown(url):
    shown = without_password(url)
    assert "host" in shown
    assert "se@" not in shown and "cret" not in shown


@pytest.mark.parametrize(
    ("url", "name"),
    [
        ("rtsp://user:secret@10.0.0.7/Streaming/101", "10.0.0.7-Streaming-101"),
        ("rtsp://10.0.0.7", "10.0.0.7"),
        ("rtsp://10.0.0.8:554/101?channel=2", "10.0.0.8-554-101-channel-2"),
        ("http://host/x.m3u8?token=secret", "host-x.m3u8-token"),
    ],
)
def test_a_stream_is_called_by_its_host_and_path(url, name):
    assert stream_name(url) == name


def test_an_unknown_scheme_names_those_that_are_read():
    with pytest.raises(InputError, match=r"ftp:// is not a kind of stream .* rtsp"):
        open_source("ftp://host/video.mp4")


def test_frames_that_were_read_hold_no_memory(write_video):
    """Pictures in a cycle of references stay until Python looks for cycles: a watch grew by 100 MB
    a minute.
    """
    clip = write_video("clip.mp4")
    gc.collect()
    gc.disable()
    try:
        with open_source(clip) as source:
            for frame in source.frames():
                if frame.index % 20 == 19:
                    alive = sum(isinstance(one, av.VideoFrame) for one in gc.get_objects())
                    assert alive <= 16, "those that the decoder's threads are ahead"
    finally:
        gc.enable()
