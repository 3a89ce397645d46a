"""Files that are no picture of a leaf: one line each, what they are and what to do; not a word from decoders."""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from image_bytes import cmyk_jpeg, declared, encode, jpeg_segments, png_chunk
from leaf_pictures import draw_leaf
from leafwarp.errors import InputError
from leafwarp.leaf.image.photo import read_photo
from test_cli import ENVIRONMENT

SVG = b'<?xml version="1.0"?>\n<svg xmlns="http://www.w3.org/2000/svg"></svg>'
FOREIGN = {
    "animation.gif": (b"GIF89a" + bytes(60), "a GIF", "as PNG"),
    "gif_renamed.png": (b"GIF89a" + bytes(60), "a GIF", "as PNG"),
    "phone.heic": (b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + bytes(60), "a HEIC picture", "JPEG"),
    "general.heif": (b"\0\0\0\x18ftypmif1\0\0\0\0mif1heic" + bytes(60), "a HEIF picture", "JPEG"),
    "web.avif": (b"\0\0\0\x1cftypavif\0\0\0\0avifmif1" + bytes(60), "an AVIF picture", "PNG"),
    "clip.mp4": (b"\0\0\0\x18ftypmp42\0\0\0\0isommp42" + bytes(60), "a video", "frame"),
    "scan.pdf": (b"%PDF-1.7\n" + bytes(60), "a PDF document", "PNG"),
    "drawing.svg": (SVG, "an SVG drawing", "PNG"),
    "notes.txt": ("a leaf, näher besehen\n".encode(), "a text file", "photo"),
    "zeros.png": (bytes(5000), "a file of zeros", "copy"),
    "old.bmp": (b"BM" + bytes(60), "a BMP picture", "PNG"),
    "noise.png": (np.random.default_rng(3).bytes(900), "not an image", "PNG, JPEG, TIFF or WebP"),
    "camera.cr2": (
        b"II*\0\x10\0\0\0CR\x02\0" + bytes(4) + struct.pack("<H", 0) + bytes(60),
        "a camera raw file",
        "develop",
    ),
}


def refusal(path: Path, data: bytes) -> str:
    """The one line with which a file of these bytes is refused."""
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        read_photo(path)
    message = str(caught.value)
    assert str(path) in message and "\n" not in message
    assert "accepted: " in message
    return message


@pytest.mark.parametrize("name", FOREIGN)
def test_foreign_files_are_named_with_a_remedy(tmp_path: Path, name: str) -> None:
    data, kind, remedy = FOREIGN[name]
    message = refusal(tmp_path / name, data)
    assert kind in message and remedy in message


def test_animations_and_raw_files_of_accepted_formats(tmp_path: Path) -> None:
    png = encode(".png", draw_leaf())
    assert "an animation" in refusal(tmp_path / "a.png", png[:33] + png_chunk(b"acTL", bytes(8)) + png[33:])
    webp = bytearray(encode(".webp", draw_leaf()))
    webp[12:12] = b"VP8X" + struct.pack("<IB3x", 10, 2) + bytes(6) + b"ANIM" + struct.pack("<I", 6) + bytes(6)
    struct.pack_into("<I", webp, 4, len(webp) - 8)
    assert "an animation" in refusal(tmp_path / "a.webp", bytes(webp))
    entries = struct.pack("<HHII", 256, 4, 1, 40) + struct.pack("<HHII", 257, 4, 1, 40)
    dng = b"II*\0" + struct.pack("<IH", 8, 3) + entries + struct.pack("<HHI4B", 50706, 1, 4, 1, 4, 0, 0) + bytes(4)
    assert "a camera raw file" in refusal(tmp_path / "a.dng", dng)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tiff", ".webp"])
def test_a_declared_billion_pixels_is_refused_before_decoding(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = declared(suffix, 40_000, 25_000)
    assert len(data) < 20_000
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    assert "40000 x 25000 pixels; accepted: at most 150 megapixels" in refusal(tmp_path / f"huge{suffix}", data)


def damaged(suffix: str) -> bytes:
    """A picture with its structure whole and a tenth of its coded pixels overwritten."""
    data = bytearray(encode(suffix, draw_leaf(), *((cv2.IMWRITE_TIFF_COMPRESSION, 5) if suffix == ".tiff" else ())))
    first, last = len(data) * 6 // 10, len(data) * 7 // 10
    if suffix == ".tiff":  # the directory with the offsets may lie anywhere: keep to the first strips
        first, last = len(data) // 10, len(data) // 5
    data[first:last] = bytes(last - first)
    return bytes(data)


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tiff"])  # a WebP has no checksum: any bits are some picture
def test_corrupt_pixels_are_refused_without_a_word_from_the_decoder(
    tmp_path: Path, suffix: str, capfd: pytest.CaptureFixture
) -> None:
    message = refusal(tmp_path / f"damaged{suffix}", damaged(suffix))
    assert ("corrupt" in message and "copy it anew" in message) or "checksum" in message
    assert capfd.readouterr() == ("", "")


def test_a_cut_jpeg_that_was_closed_again_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    """A tool that cuts the data and puts the end marker back leaves a file that decoders fill with grey."""
    data = encode(".jpg", draw_leaf())
    assert "corrupt" in refusal(tmp_path / "cut.jpg", data[: len(data) // 2] + b"\xff\xd9")
    assert capfd.readouterr() == ("", "")


def test_harmless_metadata_is_no_fault_and_prints_nothing(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    png = encode(".png", draw_leaf())
    profile = png_chunk(b"iCCP", b"broken\0\0" + bytes(20))  # libpng warns about such a profile, and reads the pixels
    (tmp_path / "profile.png").write_bytes(png[:33] + profile + png[33:])
    np.testing.assert_array_equal(read_photo(tmp_path / "profile.png").colour, draw_leaf())
    assert capfd.readouterr() == ("", "")


def test_cmyk_jpeg_is_converted(tmp_path: Path) -> None:
    wanted = draw_leaf()
    black = 255 - wanted.max(axis=2, keepdims=True).astype(int)
    ink = 255 - 255 * (wanted.astype(int) / np.maximum(255 - black, 1))
    path = tmp_path / "cmyk.jpg"
    path.write_bytes(cmyk_jpeg(np.rint(np.concatenate([ink, black], axis=2)).astype(np.uint8)))
    assert len([1 for marker, _ in jpeg_segments(path.read_bytes()) if marker == 0xC0]) == 1
    assert np.abs(read_photo(path).colour.astype(int) - wanted).mean() < 4.0  # the codec's loss in four planes


def test_transparent_everywhere(tmp_path: Path) -> None:
    picture = np.dstack([draw_leaf(), np.zeros(draw_leaf().shape[:2], np.uint8)])
    assert "transparent everywhere" in refusal(tmp_path / "clear.png", encode(".png", picture))
    picture[..., 3] = 255
    (tmp_path / "opaque.png").write_bytes(encode(".png", picture))
    assert read_photo(tmp_path / "opaque.png").alpha is None


def test_reading_works_without_a_stderr(tmp_path: Path) -> None:
    """A program started without a terminal, as from a desktop, has no stderr to hear the decoder on."""
    path = tmp_path / "leaf.jpg"
    path.write_bytes(encode(".jpg", draw_leaf()))
    code = (
        "import os; os.close(2); from leafwarp.leaf.image.photo import read_photo; "
        f"print(read_photo({str(path)!r}).size)"
    )
    done = subprocess.run([sys.executable, "-c", code], env=ENVIRONMENT, stdout=subprocess.PIPE, text=True)
    assert (done.returncode, done.stdout) == (0, "(420, 560)\n")


@pytest.mark.parametrize("verb", [["fly"], [], ["run"], ["run", "a.toml", "--frames", "5:2"], ["run", "a", "--wrong"]])
def test_bad_calls_are_one_line_with_a_hint(verb: list[str], capsys: pytest.CaptureFixture) -> None:
    from leafwarp.cli import main

    assert main(verb) == 2
    out, err = capsys.readouterr()
    assert out == "" and len(err.splitlines()) == 1
    assert err.startswith("leafwarp: ") and "--help" in err
