"""What an image file says of itself, read from its bytes without decoding a pixel.

Decoders are poor judges of bad files: some allocate the declared size before they look at the data, some fill
the missing tail of a JPEG with grey, some print to stderr. So the structure is checked here first. Formats:
PNG, JPEG, TIFF (and BigTIFF), WebP.
"""

from __future__ import annotations

import re
import struct
import zlib
from dataclasses import dataclass

from leafwarp.leaf.image.foreign_format import name_format

_JPEG_NEXT_MARKER = re.compile(rb"\xff+([^\x00\xff\xd0-\xd7])")  # skips stuffed bytes and restart markers
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_TIFF_TYPES = {1: "B", 3: "H", 4: "I", 16: "Q"}


class BrokenImage(ValueError):
    """The bytes are not a whole image.

    Args:
        reason: Completes the sentence "the file ...".
        remedy: What to do about it, where that is more than to bring a whole image.
    """

    def __init__(self, reason: str, remedy: str | None = None):
        super().__init__(reason)
        self.remedy = remedy


@dataclass(frozen=True)
class ImageHeader:
    """Declared properties of an image file.

    Attributes:
        format: "PNG", "JPEG", "TIFF" or "WebP".
        width: Pixels across, as stored (before the orientation is applied).
        height: Pixels down, as stored.
        orientation: EXIF orientation, 1 to 8.
        orientation_span: First and last byte (exclusive) of the orientation's value in a TIFF file, else
            None.
    """

    format: str
    width: int
    height: int
    orientation: int = 1
    orientation_span: tuple[int, int] | None = None


def read_header(data: bytes) -> ImageHeader:
    """Header of an image file; raises BrokenImage where the file is no image of these formats or is incomplete."""
    try:
        if data.startswith(b"\x89PNG\r\n\x1a\n"):
            return _png(data)
        if data.startswith(b"\xff\xd8\xff"):
            return _jpeg(data)
        if data[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
            return _tiff(data)
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return _webp(data)
    except (struct.error, IndexError) as error:
        raise BrokenImage("is truncated") from error
    known = name_format(data)
    if known is None:
        raise BrokenImage("is not an image of a known format")
    raise BrokenImage(f"is {known[0]}", known[1])


def _png(data: bytes) -> ImageHeader:
    width, height = struct.unpack_from(">II", data, 16)
    orientation, position, ended = 1, 8, False
    while not ended:
        length, kind = struct.unpack_from(">I4s", data, position)
        content = memoryview(data)[position + 4 : position + 8 + length]  # the checksum covers the type too
        (checksum,) = struct.unpack_from(">I", data, position + 8 + length)
        if zlib.crc32(content) != checksum:
            raise BrokenImage(f"is corrupt (checksum of the PNG chunk {kind.decode('latin-1')!r})")
        if kind == b"acTL":
            raise BrokenImage("is an animation", "save one picture of it as PNG")
        if kind == b"eXIf":
            orientation = _exif_orientation(bytes(content[4:]))
        ended = kind == b"IEND"
        position += 12 + length
    return ImageHeader("PNG", width, height, orientation)


def _jpeg(data: bytes) -> ImageHeader:
    size, orientation, position = None, 1, 2
    while True:
        found = _JPEG_NEXT_MARKER.search(data, position)
        if found is None:
            raise BrokenImage("is truncated (no end of the JPEG data)")
        marker, position = found.group(1)[0], found.end()
        if marker == 0xD9:
            break
        if marker == 0x01:
            continue
        (length,) = struct.unpack_from(">H", data, position)
        if marker in _JPEG_FRAMES and size is None:
            height, width = struct.unpack_from(">HH", data, position + 3)
            size = (width, height)
        elif marker == 0xE1 and data[position + 2 : position + 8] == b"Exif\0\0":
            orientation = _exif_orientation(data[position + 8 : position + length])
        position += length
    if size is None:
        raise BrokenImage("is corrupt (JPEG without a frame)")
    return ImageHeader("JPEG", *size, orientation)


def _webp(data: bytes) -> ImageHeader:
    (content_size,) = struct.unpack_from("<I", data, 4)
    if len(data) < content_size + 8:
        raise BrokenImage("is truncated")
    size, orientation, position = None, 1, 12
    while position + 8 <= content_size + 8:
        kind, length = struct.unpack_from("<4sI", data, position)
        start = position + 8
        if kind == b"ANIM":
            raise BrokenImage("is an animation", "save one picture of it as PNG")
        if kind == b"VP8X":
            size = tuple(1 + int.from_bytes(data[start + at : start + at + 3], "little") for at in (4, 7))
        elif kind == b"VP8L" and size is None:
            (bits,) = struct.unpack_from("<I", data, start + 1)
            size = (1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF))
        elif kind == b"VP8 " and size is None:
            width, height = struct.unpack_from("<HH", data, start + 6)
            size = (width & 0x3FFF, height & 0x3FFF)
        elif kind == b"EXIF":
            orientation = _exif_orientation(data[start : start + length].removeprefix(b"Exif\0\0"))
        position = start + length + length % 2
    if size is None:
        raise BrokenImage("is corrupt (WebP without a picture)")
    return ImageHeader("WebP", *size, orientation)


def _tiff(data: bytes) -> ImageHeader:
    tags = _tiff_tags(data)
    if 50706 in tags or data[8:10] == b"CR":  # DNG's version; Canon's mark
        raise BrokenImage("is a camera raw file", "develop it to TIFF or JPEG")
    if 256 not in tags or 257 not in tags:
        raise BrokenImage("is corrupt (TIFF without a size)")
    for offset_tag, count_tag in ((273, 279), (324, 325)):  # strips, tiles
        offsets, counts = (tags.get(tag, ([], None))[0] for tag in (offset_tag, count_tag))
        if any(offset + count > len(data) for offset, count in zip(offsets, counts, strict=False)):
            raise BrokenImage("is truncated")
    orientation, span = tags.get(274, ([1], None))
    return ImageHeader("TIFF", tags[256][0][0], tags[257][0][0], _valid_orientation(orientation[0]), span)


def _exif_orientation(block: bytes) -> int:
    """Orientation from an EXIF block (a small TIFF); 1 where it has none or cannot be read."""
    try:
        return _valid_orientation(_tiff_tags(block).get(274, ([1], None))[0][0])
    except (BrokenImage, struct.error, IndexError):
        return 1


def _valid_orientation(value: int) -> int:
    return value if 1 <= value <= 8 else 1


def _tiff_tags(data: bytes) -> dict[int, tuple[tuple[int, ...], tuple[int, int]]]:
    """Integer tags of the first image directory: values, and the span of bytes they stand in."""
    order = {b"II": "<", b"MM": ">"}.get(data[:2])
    if order is None:
        raise BrokenImage("is corrupt (TIFF byte order)")
    (version,) = struct.unpack_from(order + "H", data, 2)
    big = version == 43
    word, word_size, entry_size = ("Q", 8, 20) if big else ("I", 4, 12)
    (directory,) = struct.unpack_from(order + word, data, 8 if big else 4)
    (count,) = struct.unpack_from(order + ("Q" if big else "H"), data, directory)
    first = directory + (8 if big else 2)
    tags = {}
    for entry in range(first, first + entry_size * min(count, 4096), entry_size):
        tag, kind, values = struct.unpack_from(order + "HH" + word, data, entry)
        if kind not in _TIFF_TYPES or not 0 < values <= len(data):
            continue
        form = f"{order}{values}{_TIFF_TYPES[kind]}"
        at = entry + entry_size - word_size
        if struct.calcsize(form) > word_size:
            (at,) = struct.unpack_from(order + word, data, at)
        tags[tag] = (struct.unpack_from(form, data, at), (at, at + struct.calcsize(form)))
    return tags
