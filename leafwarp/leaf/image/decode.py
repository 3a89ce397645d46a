"""Decoding an image whose header was accepted, and hearing what the decoder has to say about it.

The decoders under OpenCV fill what they cannot decode with grey, return the picture as if nothing had happened and
say so on the process's stderr alone. So that is read here: it decides, and none of it reaches the user's terminal.
"""

from __future__ import annotations

import contextlib
import os
import re
import sys
import tempfile
from collections.abc import Iterator

import numpy as np

from leafwarp.leaf.image.header import BrokenImage, ImageHeader

# Complaints of libjpeg, OpenCV's TIFF reader and libpng that mean lost pixels; any other is about metadata.
_LOST_PIXELS = re.compile(
    r"(Corrupt JPEG data[^\n]*|Premature end of JPEG[^\n]*|TIFF_Error [^\n]*|libpng error[^\n]*)", re.IGNORECASE
)


def decode(data: bytes, header: ImageHeader) -> np.ndarray:
    """Pixels as stored (any depth, blue first, not turned upright), shape [height, width] or with channels.

    Args:
        data: The whole file.
        header: What it says of itself, checked.

    Raises:
        BrokenImage: The decoder fails, or makes up what it cannot read.
    """
    import cv2

    if header.orientation_span is not None and header.orientation != 1:
        # OpenCV fails on TIFF files whose orientation swaps the axes: decode as if upright, turn afterwards.
        first, last = header.orientation_span
        upright = (1).to_bytes(last - first, "little" if data[:2] == b"II" else "big")
        data = data[:first] + upright + data[last:]
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_WARNING)
    pixels = None
    try:
        with _captured_stderr() as complaints, contextlib.suppress(cv2.error):
            pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    finally:
        cv2.utils.logging.setLogLevel(level)
    lost = _LOST_PIXELS.search(complaints[0]) if complaints else None
    if lost is not None:
        raise BrokenImage(f"is corrupt ({lost.group(0).strip()})")
    if pixels is None or pixels.shape[:2] != (header.height, header.width):
        raise BrokenImage(f"is corrupt (its {header.format} data cannot be decoded)")
    return pixels


@contextlib.contextmanager
def _captured_stderr() -> Iterator[list[str]]:
    """All that C libraries write to stderr in the block; the list holds it as one string once the block has ended.

    This turns away the stderr of the whole process, its other threads included, for as long as it lasts.
    """
    caught: list[str] = []
    with contextlib.suppress(OSError, ValueError):
        sys.stderr.flush()
    try:
        terminal = os.dup(2)
    except OSError:  # the process was started without a stderr: nobody hears a decoder then
        yield caught
        return
    try:
        with tempfile.TemporaryFile() as file:
            os.dup2(file.fileno(), 2)
            try:
                yield caught
            finally:
                os.dup2(terminal, 2)
            file.seek(0)
            caught.append(file.read(65536).decode(errors="replace"))
    finally:
        os.close(terminal)
