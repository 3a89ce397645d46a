"""Image files: what is read, what is refused and with which words; the leaf found in them."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from leaf_pictures import (
    BASE,
    HEIGHT,
    TIP,
    WIDTH,
    blade_outline,
    coverage,
    draw_leaf,
    petiole_outline,
    true_length,
    write_image,
)
from leafwarp.errors import InputError
from leafwarp.leaf.image.header import read_header
from leafwarp.leaf.image.photo import read_grey, read_photo
from leafwarp.leaf.segment.silhouette import silhouette
from leafwarp.leaf.shape.outline import find_outline

FORMATS = (".png", ".jpg", ".tiff", ".webp")


def refusal(path: Path) -> str:
    """The one line with which a picture is refused."""
    with pytest.raises(InputError) as caught:
        silhouette(read_photo(path))
    message = str(caught.value)
    assert str(path) in message and "\n" not in message
    return message


def png_chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def with_orientation(data: bytes, orientation: int) -> bytes:
    """A PNG or JPEG with an EXIF orientation put in."""
    block = b"II*\0" + struct.pack("<IHHHIHHI", 8, 1, 274, 3, 1, orientation, 0, 0)
    if data.startswith(b"\x89PNG"):
        return data[:33] + png_chunk(b"eXIf", block) + data[33:]
    segment = b"Exif\0\0" + block
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + data[2:]


@pytest.mark.parametrize("suffix", FORMATS)
def test_formats_are_read_alike(tmp_path: Path, suffix: str) -> None:
    picture = draw_leaf()
    path = write_image(tmp_path / f"leaf{suffix}", picture)
    header = read_header(path.read_bytes())
    assert (header.width, header.height, header.orientation) == (WIDTH, HEIGHT, 1)
    read = read_photo(path).colour
    lossless = suffix in (".png", ".tiff")
    assert np.abs(read.astype(int) - picture).mean() <= (0.0 if lossless else 4.0)  # the codecs' loss on grain


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("kept", [0.02, 0.5, 0.97])
def test_truncated_file_is_refused(tmp_path: Path, suffix: str, kept: float) -> None:
    path = write_image(tmp_path / f"leaf{suffix}", draw_leaf())
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data))])
    message = refusal(path)
    assert "truncated" in message or "corrupt" in message


def test_flipped_bit_is_refused(tmp_path: Path) -> None:
    path = write_image(tmp_path / "leaf.png", draw_leaf())
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    assert "checksum" in refusal(path)


def test_files_that_are_no_image(tmp_path: Path) -> None:
    (tmp_path / "empty.png").write_bytes(b"")
    (tmp_path / "text.png").write_text("a leaf\n" * 100)
    assert "no such file" in refusal(tmp_path / "missing.png")
    assert "is a folder" in refusal(tmp_path)
    assert "is empty" in refusal(tmp_path / "empty.png")
    assert "not an image" in refusal(tmp_path / "text.png")


@pytest.mark.parametrize("size", [(1, 1), (31, 200), (200, 31)])
def test_tiny_image_is_refused(tmp_path: Path, size: tuple[int, int]) -> None:
    path = write_image(tmp_path / "tiny.png", np.full((size[1], size[0], 3), 90, np.uint8))
    assert f"{size[0]} x {size[1]} pixels" in refusal(path)


def test_huge_image_is_refused_by_its_header(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    side = 20_000
    rows = zlib.compress(bytes((side // 8 + 1) * side), 1)
    header = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    path = tmp_path / "huge.png"
    chunks = png_chunk(b"IHDR", header) + png_chunk(b"IDAT", rows) + png_chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunks)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    assert "20000 x 20000 pixels; accepted: at most 150 megapixels" in refusal(path)


def test_pictures_without_a_leaf(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    slope = np.linspace(90, 210, 300)[None, :, None] * np.ones((200, 1, 3))
    scale = np.array([0.55, 1.0, 0.4])
    for name, pixels in {
        "plain": np.full((200, 300, 3), 180.0),
        "grain": 180 + random.normal(0, 12, (200, 300, 3)),
        "slope": slope,
        "green": (slope + random.normal(0, 6, (200, 300, 3))) * scale,
    }.items():
        path = write_image(tmp_path / f"{name}.png", np.clip(pixels, 0, 255).astype(np.uint8))
        assert "found" in refusal(path)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation(tmp_path: Path, suffix: str, orientation: int) -> None:
    upright = np.zeros((40, 60, 3), np.uint8)
    upright[:20, :30] = (200, 30, 30)
    upright[:20, 30:] = (30, 200, 30)
    upright[20:, :30] = (30, 30, 200)
    stored = upright.swapaxes(0, 1) if orientation >= 5 else upright
    # Where the first stored row and column stand in the upright picture (EXIF 2.3, tag 274).
    if orientation in (2, 3, 7, 8):
        stored = stored[:, ::-1]
    if orientation in (3, 4, 6, 7):
        stored = stored[::-1]
    path = write_image(tmp_path / f"turned{suffix}", np.ascontiguousarray(stored))
    path.write_bytes(with_orientation(path.read_bytes(), orientation))
    read = read_photo(path).colour
    assert read.shape == upright.shape
    assert np.abs(read.astype(int) - upright)[5:15, 5:25].max() < 40  # JPEG's chroma loss away from the seams


def test_depths_and_opacity(tmp_path: Path) -> None:
    picture = draw_leaf(veins=False)
    cover = coverage(blade_outline(), petiole_outline())
    grey = write_image(tmp_path / "grey.png", cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))
    deep = write_image(tmp_path / "deep.png", picture.astype(np.uint16) * 257)
    opaque = np.dstack([np.full_like(picture, 120), np.rint(255 * cover).astype(np.uint8)])
    alpha = write_image(tmp_path / "alpha.png", opaque)
    np.testing.assert_array_equal(read_photo(deep).colour, picture)
    for path in (grey, deep, alpha):
        shape = silhouette(read_photo(path))
        missed = (shape.inside != (cover > 0.5)).mean()
        assert missed < 0.006, path  # about a pixel along the margin
    ramp = write_image(tmp_path / "ramp.png", np.arange(0, 65536, 1024, dtype=np.uint16)[None].repeat(2, axis=0))
    np.testing.assert_allclose(read_grey(ramp)[0], np.arange(0, 65536, 1024) / 65535.0, rtol=1e-12)


def plain_tiff(pixels: np.ndarray, orientation: int) -> bytes:
    """An uncompressed RGB TIFF of one strip, with an orientation tag."""
    height, width = pixels.shape[:2]
    tags = [(256, width), (257, height), (258, 8), (259, 1), (262, 2), (273, 0), (274, orientation), (277, 3)]
    tags += [(278, height), (279, pixels.size), (284, 1)]
    first = 8 + 2 + 12 * len(tags) + 4
    entries = b""
    for tag, value in tags:
        if tag == 258:  # three values of 16 bits do not fit into the entry
            entries += struct.pack("<HHII", tag, 3, 3, first)
        else:
            entries += struct.pack("<HHII", tag, 4, 1, first + 6 if tag == 273 else value)
    head = b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + struct.pack("<I", 0)
    return head + struct.pack("<HHH", 8, 8, 8) + pixels.tobytes()


def test_tiff_orientation_that_swaps_the_axes(tmp_path: Path) -> None:
    path = tmp_path / "turned.tiff"
    path.write_bytes(plain_tiff(draw_leaf(), orientation=6))
    np.testing.assert_array_equal(read_photo(path).colour, np.rot90(draw_leaf(), -1))
    path.write_bytes(plain_tiff(draw_leaf(), orientation=1)[:-1])
    assert "truncated" in refusal(path)


@pytest.mark.parametrize("teeth", [0, 40])
def test_shape_and_petiole_of_a_drawn_leaf(tmp_path: Path, teeth: int) -> None:
    photo = read_photo(write_image(tmp_path / "leaf.png", draw_leaf(teeth=teeth, depth=0.06 if teeth else 0.0)))
    shape = silhouette(photo)
    truth = coverage(blade_outline(teeth, 0.06 if teeth else 0.0), petiole_outline()) > 0.5
    assert (shape.inside != truth).mean() < 0.006  # about a pixel along the margin; none of the shadow
    outline = find_outline(photo, shape)
    length = true_length(teeth, 0.06 if teeth else 0.0)
    assert np.linalg.norm(outline.base - BASE) < 0.03 * length
    assert abs(outline.length - length) < 0.03 * length
    assert 0.6 * 9.0 < outline.petiole_width < 1.6 * 9.0


def test_outline_is_below_a_pixel_and_smooth(tmp_path: Path) -> None:
    photo = read_photo(write_image(tmp_path / "leaf.png", draw_leaf(petiole=False, veins=False)))
    points = find_outline(photo, silhouette(photo), base=(210.0, 420.0)).points
    offset = (np.hypot((points[:, 0] - 210.0) / 120.0, (points[:, 1] - 230.0) / 190.0) - 1.0) * 150.0
    assert np.abs(offset).max() < 1.0 and offset.std() < 0.35  # [pixels]; stair steps would give 0.3 and more alone


def test_base_override_and_its_refusal(tmp_path: Path) -> None:
    photo = read_photo(write_image(tmp_path / "leaf.png", draw_leaf()))
    shape = silhouette(photo)
    assert np.linalg.norm(find_outline(photo, shape, base=(212.0, 38.0)).base - TIP) < 3.0
    for bad in ((-1.0, 5.0), (5.0, HEIGHT + 1.0), (np.nan, 5.0)):
        with pytest.raises(InputError, match="base: value"):
            find_outline(photo, shape, base=bad)


def test_base_without_a_stalk_is_where_the_veins_lead(tmp_path: Path) -> None:
    photo = read_photo(write_image(tmp_path / "leaf.png", draw_leaf(petiole=False)))
    outline = find_outline(photo, silhouette(photo))
    assert np.linalg.norm(outline.base - (210.0, 420.0)) < 20.0
