"""Pictures in and out: whole ones come back, everything else says what is wrong with it."""

import struct

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geoerr.errors import InputFileError, ShapeError
from geoerr.vision.images import encode_png, picture_size, read_grey, write_png

NOISE = np.random.default_rng(5).integers(0, 256, (48, 64), dtype=np.uint8)


def encoded(suffix, image=NOISE, settings=()):
    done, content = cv2.imencode(suffix, image, list(settings))
    assert done
    return content.tobytes()


WHOLE = {
    ".png": encoded(".png"),
    ".jpg": encoded(".jpg"),
    ".tif": encoded(".tif", settings=[cv2.IMWRITE_TIFF_COMPRESSION, 1]),
}


def test_a_png_comes_back_as_it_was(tmp_path):
    write_png(tmp_path / "a.png", NOISE)
    assert np.array_equal(read_grey(tmp_path / "a.png"), NOISE)
    assert read_grey(tmp_path / "a.png").dtype == np.uint8


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_lossless_kinds_are_read_exactly(tmp_path, suffix):
    (tmp_path / "a").write_bytes(WHOLE[suffix])
    assert np.array_equal(read_grey(tmp_path / "a"), NOISE)


def test_colour_and_sixteen_bits_become_grey(tmp_path):
    (tmp_path / "a.tif").write_bytes(encoded(".tif", (NOISE.astype(np.uint16) << 8) + 0x37))
    assert np.array_equal(read_grey(tmp_path / "a.tif"), NOISE)
    (tmp_path / "b.png").write_bytes(encoded(".png", np.repeat(NOISE[..., None], 3, axis=2)))
    assert np.array_equal(read_grey(tmp_path / "b.png"), NOISE)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize(("bits", "factor"), [(10, 64), (12, 16)])
def test_bits_at_the_lower_end_of_sixteen_are_refused_with_what_to_do(tmp_path, suffix, bits, factor):
    """What a camera of 10 or 12 bits writes when nobody shifts them up: 4 or 16 grey levels of 256 would be left."""
    values = NOISE.astype(np.uint16) << (bits - 8)
    path = tmp_path / f"a{suffix}"
    path.write_bytes(encoded(suffix, values))
    with pytest.raises(InputFileError, match=f"largest of its 16-bit values is {values.max()}") as caught:
        read_grey(path)
    assert f"{bits} bits times {factor}" in caught.value.remedy
    path.write_bytes(encoded(suffix, values * factor))
    assert np.array_equal(read_grey(path), NOISE)
    # All black is what a cap on the lens shows, in any depth.
    path.write_bytes(encoded(suffix, np.zeros_like(values)))
    assert not read_grey(path).any()


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int32])
@pytest.mark.parametrize("channels", [1, 3])
def test_values_of_which_none_is_said_to_be_white_are_refused(tmp_path, dtype, channels):
    """What ImageJ and scikit-image write: OpenCV decodes it in its own depth, and gives nothing as 8-bit grey."""
    path = tmp_path / "a.tif"
    path.write_bytes(encoded(".tif", np.repeat(NOISE[..., None], channels, axis=2).astype(dtype)))
    kind = "whole" if dtype is np.int32 else "floating-point"
    for read in (read_grey, picture_size):
        with pytest.raises(InputFileError, match=f"{kind} numbers of {8 * dtype().itemsize} bits") as caught:
            read(path)
        assert "8 or 16 bits" in caught.value.remedy


def test_a_note_to_turn_the_picture_is_ignored(tmp_path):
    ifd = struct.pack("<HHHIHHI", 1, 0x0112, 3, 1, 6, 0, 0)
    exif = b"Exif\0\0" + b"II*\0" + struct.pack("<I", 8) + ifd
    plain = WHOLE[".jpg"]
    (tmp_path / "a.jpg").write_bytes(plain[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + plain[2:])
    assert cv2.imread(str(tmp_path / "a.jpg"), cv2.IMREAD_GRAYSCALE).shape == (64, 48)
    assert read_grey(tmp_path / "a.jpg").shape == (48, 64)
    assert picture_size(tmp_path / "a.jpg") == (64, 48)


@pytest.mark.parametrize("suffix", sorted(WHOLE))
def test_the_size_is_told_without_decoding(tmp_path, suffix, monkeypatch):
    monkeypatch.delattr(cv2, "imdecode")
    (tmp_path / "a").write_bytes(WHOLE[suffix])
    assert picture_size(tmp_path / "a") == (64, 48)


def test_a_picture_whose_header_has_no_size_is_damaged(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8\xff\xda\x00\x02\x00\xff\xd9")
    with pytest.raises(InputFileError, match="its header has no size"):
        picture_size(tmp_path / "a.jpg")


@settings(max_examples=60)
@given(share=st.floats(0.0, 1.0), suffix=st.sampled_from(sorted(WHOLE)))
def test_a_picture_cut_anywhere_is_refused(tmp_path_factory, share, suffix):
    content = WHOLE[suffix]
    path = tmp_path_factory.mktemp("cut") / "cut"
    path.write_bytes(content[: int(share * (len(content) - 2))])
    for read in (read_grey, picture_size):
        with pytest.raises(InputFileError, match=r"truncated|empty|not a picture") as refusal:
            read(path)
        assert str(path) in str(refusal.value)


@settings(max_examples=40)
@given(place=st.integers(8, len(WHOLE[".png"]) - 1), flip=st.integers(1, 255))
def test_a_png_with_one_byte_changed_is_never_read(tmp_path_factory, place, flip):
    content = bytearray(WHOLE[".png"])
    content[place] ^= flip
    path = tmp_path_factory.mktemp("changed") / "changed.png"
    path.write_bytes(bytes(content))
    with pytest.raises(InputFileError, match=r"truncated|damaged"):
        read_grey(path)


def test_what_is_no_picture_is_refused_by_name(tmp_path):
    (tmp_path / "empty.png").write_bytes(b"")
    (tmp_path / "text.png").write_text("x, y, z\n")
    for path, message in (
        (tmp_path / "none.png", "no such picture"),
        (tmp_path, "is a folder"),
        (tmp_path / "empty.png", "empty"),
        (tmp_path / "text.png", "not a picture"),
    ):
        with pytest.raises(InputFileError, match=message):
            read_grey(path)


def test_only_grey_pictures_are_written(tmp_path):
    for wrong in (NOISE.astype(np.float64), np.zeros((4, 4, 3), np.uint8), np.zeros((0, 4), np.uint8)):
        with pytest.raises(ShapeError):
            encode_png(wrong)
    with pytest.raises(InputFileError, match="does not exist"):
        write_png(tmp_path / "none" / "a.png", NOISE)
