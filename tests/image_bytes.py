"""Image files put together byte by byte, for what no encoder of OpenCV writes."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np


def png_chunk(kind: bytes, content: bytes) -> bytes:
    """A chunk of a PNG with its checksum."""
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def encode(suffix: str, pixels: np.ndarray, *options: int) -> bytes:
    """RGB, RGBA or grey pixels in a format that OpenCV writes."""
    code = {3: cv2.COLOR_RGB2BGR, 4: cv2.COLOR_RGBA2BGRA}
    stored = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, code[pixels.shape[2]])
    done, data = cv2.imencode(suffix, stored, options)
    assert done
    return data.tobytes()


def jpeg_segments(data: bytes) -> list[tuple[int, bytes]]:
    """Marker and content of each segment of a JPEG; that of the scan (0xDA) is followed by its coded data."""
    segments, position = [], 2
    while data[position + 1] != 0xD9:
        marker, length = data[position + 1], struct.unpack_from(">H", data, position + 2)[0]
        end = len(data) - 2 if marker == 0xDA else position + 2 + length
        segments.append((marker, data[position + 2 : end]))
        position = end
    return segments


def cmyk_jpeg(cmyk: np.ndarray) -> bytes:
    """A JPEG of four ink planes as Adobe writes it (255 is no ink), each in a scan of its own.

    Args:
        cmyk: Ink in [0, 255], shape [height, width, 4], 255 being full ink.
    """
    planes = [jpeg_segments(encode(".jpg", 255 - cmyk[..., ink], cv2.IMWRITE_JPEG_QUALITY, 95)) for ink in range(4)]
    height, width = cmyk.shape[:2]
    frame = struct.pack(">HBHHB", 8 + 12, 8, height, width, 4) + b"".join(bytes([ink, 0x11, 0]) for ink in range(1, 5))
    adobe = struct.pack(">H5sHHHB", 14, b"Adobe", 100, 0, 0, 0)
    data = b"\xff\xd8\xff\xee" + adobe
    for marker, content in planes[0]:
        if marker in (0xDB, 0xC4):
            data += bytes([0xFF, marker]) + content
    data += b"\xff\xc0" + frame
    for ink, plane in enumerate(planes, start=1):
        ((_, scan),) = [segment for segment in plane if segment[0] == 0xDA]
        data += b"\xff\xda" + struct.pack(">HBBBBBB", 8, 1, ink, 0x00, 0, 63, 0) + scan[8:]
    return data + b"\xff\xd9"


def declared(suffix: str, width: int, height: int) -> bytes:
    """A whole, small file whose header declares so many pixels."""
    pixels = np.full((40, 40, 3), 90, np.uint8)
    if suffix == ".png":
        header = png_chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
        return b"\x89PNG\r\n\x1a\n" + header + encode(".png", pixels)[33:]
    data = bytearray(encode(suffix, pixels))
    if suffix == ".jpg":
        struct.pack_into(">HH", data, data.index(b"\xff\xc0") + 5, height, width)
    elif suffix == ".webp":
        # An extended header before the picture: 24 bits each of width - 1 and height - 1.
        extended = b"VP8X" + struct.pack("<IB3x", 10, 0) + (width - 1).to_bytes(3, "little")
        data[12:12] = extended + (height - 1).to_bytes(3, "little")
        struct.pack_into("<I", data, 4, len(data) - 8)
    else:
        for tag, value in ((256, width), (257, height)):
            for kind in (3, 4):
                entry = data.find(struct.pack("<HHI", tag, kind, 1))
                if entry >= 0:
                    data[entry : entry + 12] = struct.pack("<HHII", tag, 4, 1, value)
    return bytes(data)
