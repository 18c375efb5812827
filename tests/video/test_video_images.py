"""Images as footage: order, formats, and what is refused."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.video._images import natural_key
from scene4d.video.reader import open_source


def save(path: Path, value: int = 100, size: tuple[int, int] = (40, 30)) -> Path:
    cv2.imwrite(str(path), np.full((size[1], size[0], 3), value, np.uint8))
    return path


def test_a_folder_is_read_in_natural_order_without_a_clock(tmp_path):
    for i in (10, 2, 1, 33):
        save(tmp_path / f"frame_{i}.png", i)
    (tmp_path / "notes.txt").write_text("left alone")
    (tmp_path / "._frame_1.png").write_bytes(b"left by a file manager")
    source = open_source(tmp_path)
    frames = list(source.frames())
    assert [f.image_bgr[0, 0, 0] for f in frames] == [1, 2, 10, 33]
    assert [f.index for f in frames] == [0, 1, 2, 3]
    assert np.isnan([f.time_s for f in frames]).all()
    assert (source.image_size, source.frame_count) == ((40, 30), 4)
    assert (source.fps, source.duration_s) == (None, None)
    assert [f.index for f in source.frames([3, 1])] == [1, 3]


def test_a_glob_and_a_name_that_only_looks_like_one(tmp_path):
    for i in (3, 20):
        save(tmp_path / f"a{i}.png", i)
    save(tmp_path / "b1.png", 7)
    save(tmp_path / "x[1].png", 9)
    found = [f.image_bgr[0, 0, 0] for f in open_source(f"{tmp_path}/a*.png").frames()]
    assert found == [3, 20]
    assert next(open_source(tmp_path / "x[1].png").frames()).image_bgr[0, 0, 0] == 9


def test_a_glob_that_matches_one_video_opens_it(write_video, tmp_path):
    write_video("only.mp4", 5)
    assert open_source(f"{tmp_path}/*.mp4").frame_count == 5


@given(st.lists(st.integers(0, 10**6), min_size=1, max_size=8, unique=True))
def test_natural_order_is_the_order_of_the_numbers(numbers):
    paths = sorted((Path(f"cam3_{n}.jpg") for n in numbers), key=natural_key)
    assert paths == [Path(f"cam3_{n}.jpg") for n in sorted(numbers)]


@given(st.lists(st.text("0123456789ab²٣_", min_size=1), min_size=2, max_size=6, unique=True))
def test_natural_order_is_total(names):
    paths = [Path(n) for n in names]
    shuffled = paths[1:] + paths[:1]
    assert sorted(paths, key=natural_key) == sorted(shuffled, key=natural_key)


GREY16 = (np.arange(1200, dtype=np.uint16) * 54).reshape(30, 40)


@pytest.mark.parametrize(
    ("name", "image", "expected"),
    [
        ("grey.png", (GREY16 >> 8).astype(np.uint8), GREY16 >> 8),
        ("grey16.png", GREY16, GREY16 >> 8),
        ("grey16.tiff", GREY16, GREY16 >> 8),
        ("rgba.png", np.dstack([(GREY16 >> 8).astype(np.uint8)] * 3 + [GREY16 // 400]), None),
    ],
)
def test_every_pixel_format_becomes_8_bit_bgr(tmp_path, name, image, expected):
    if expected is None:
        image, expected = image.astype(np.uint8), GREY16 >> 8
    cv2.imwrite(str(tmp_path / name), image)
    frame = next(open_source(tmp_path / name).frames())
    assert frame.image_bgr.dtype == np.uint8
    assert frame.image_bgr.shape == (30, 40, 3)
    assert np.abs(frame.image_bgr.astype(int) - expected[..., None]).max() <= 1
    assert frame.time_s == 0


def test_images_of_different_size_name_the_image_and_the_sizes(tmp_path):
    save(tmp_path / "a1.png")
    save(tmp_path / "a2.png", size=(50, 30))
    with pytest.raises(InputError, match=r"image a2\.png is 50x30 .* first frame is 40x30"):
        list(open_source(tmp_path).frames())


def test_damaged_images_are_left_out_and_counted(tmp_path):
    for i in range(4):
        save(tmp_path / f"a{i}.jpg", size=(400, 300))
    (tmp_path / "a0.jpg").write_bytes(b"")
    data = (tmp_path / "a2.jpg").read_bytes()
    (tmp_path / "a2.jpg").write_bytes(data[: len(data) // 2])
    source = open_source(tmp_path)
    assert [f.index for f in source.frames()] == [1, 3]
    (warning,) = source.warnings
    assert "2 of 4 images were left out" in warning
    assert "a0.jpg: is empty" in warning


def png_header(width: int, height: int) -> bytes:
    """The beginning of a PNG file of that size, without any pixels (RFC 2083)."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        crc = zlib.crc32(kind + data)
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", crc)

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b""))


@pytest.mark.parametrize("size", [(40_000, 40_000), (30_000, 30_000), (14_000, 13_000), (9000, 2)])
def test_too_large_a_picture_is_refused_by_its_header(tmp_path, monkeypatch, size):
    path = write(tmp_path / "a.png", png_header(*size))
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("its pixels were decoded"))
    with pytest.raises(InputError, match=r"a\.png: found a picture of"):
        open_source(path)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda d: d, "the folder holds no images; expected files that end in"),
        (lambda d: f"{d}/*.jpg", r"\*\.jpg: matches no file; check the pattern"),
        (lambda d: d / "absent.jpg", r"absent\.jpg: cannot be read: No such file"),
        (lambda d: write(d / "zero.jpg", b""), r"zero\.jpg: is empty \(0 bytes\)"),
        (lambda d: write(d / "bad.png", b"no image"), r"bad\.png: is not an image"),
        (lambda d: write(d / "bad.png", b"no image").parent, "none of its 2 images can be read"),
        (lambda d: f"{write(d / 'b.txt', b'x').parent}/*", "a glob must match images only"),
    ],
)
def test_what_cannot_be_opened(tmp_path, make, message):
    if "none of" in message or "glob must" in message:
        write(tmp_path / "also.png", b"no image either")
    with pytest.raises(InputError, match=message):
        open_source(make(tmp_path))


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path
