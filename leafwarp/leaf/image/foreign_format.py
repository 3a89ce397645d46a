"""Names of the files that people bring instead of a PNG, JPEG, TIFF or WebP picture, and what to do with each."""

from __future__ import annotations

import re

_CONVERT = "open it in an image editor and export it as PNG or JPEG"
_PHONE = "export it as JPEG (on a phone: share it as 'most compatible')"

# First bytes of a file, what it is, and the remedy.
_BEGINNINGS: tuple[tuple[bytes, str, str], ...] = (
    (b"GIF8", "a GIF, which has too few colours", "export a still picture from it as PNG"),
    (b"BM", "a BMP picture", _CONVERT),
    (b"%PDF", "a PDF document", "export its page or its picture as PNG"),
    (b"8BPS", "a Photoshop document", _CONVERT),
    (b"\0\0\1\0", "an icon", _CONVERT),
    (b"\0\0\0\x0cjP  ", "a JPEG 2000 picture", _CONVERT),
    (b"\xff\x4f\xff\x51", "a JPEG 2000 picture", _CONVERT),
    (b"\0\0\0\x0cJXL ", "a JPEG XL picture", _CONVERT),
    (b"\xff\x0a", "a JPEG XL picture", _CONVERT),
    (b"v/1\x01", "an OpenEXR picture", _CONVERT),
    (b"#?RADIANCE", "a Radiance picture", _CONVERT),
    (b"FUJIFILMCCD-RAW", "a camera raw file", "develop it to TIFF or JPEG"),
    (b"IIU\0", "a camera raw file", "develop it to TIFF or JPEG"),
    (b"PK\x03\x04", "a ZIP archive or an office document", "take the picture out of it"),
)
# ISO base media files name their brand at byte 8.
_BRANDS: tuple[tuple[bytes, str, str], ...] = (
    (b"avif", "an AVIF picture", _CONVERT),
    (b"avis", "an AVIF animation", _CONVERT),
    (b"heic", "a HEIC picture", _PHONE),
    (b"heix", "a HEIC picture", _PHONE),
    (b"hevc", "a HEIC sequence", _PHONE),
    (b"mif1", "a HEIF picture", _PHONE),
    (b"msf1", "a HEIF sequence", _PHONE),
    (b"crx ", "a camera raw file", "develop it to TIFF or JPEG"),
)
_MARKUP = re.compile(rb"<svg[\s>]", re.IGNORECASE)


def name_format(data: bytes) -> tuple[str, str] | None:
    """What a file is that is no picture of an accepted format, and what to do with it; None where nothing is known.

    Args:
        data: Its bytes.

    Returns:
        What the file is, after "is" ("a PDF document"), and the remedy as an order ("export ...").
    """
    for beginning, name, remedy in _BEGINNINGS:
        if data.startswith(beginning):
            return name, remedy
    if data[4:8] == b"ftyp":
        brands = (data[8:12], *(data[at : at + 4] for at in range(16, min(len(data), 64), 4)))
        for brand, name, remedy in _BRANDS:
            if brand in brands[:1]:
                return name, remedy
        for brand, name, remedy in _BRANDS:
            if brand in brands[1:]:
                return name, remedy
        return "a video", "export one frame of it as PNG or JPEG"
    if _MARKUP.search(data[:4096]):
        return "an SVG drawing", "export it as PNG"
    if not data[:4096].strip(b"\0"):
        return "a file of zeros", "copy it anew from the camera"
    return _as_text(data[:4096])


def _as_text(beginning: bytes) -> tuple[str, str] | None:
    """A text file, by its first bytes: no control characters but white space."""
    try:
        text = beginning.decode("utf-8", errors="strict")
    except UnicodeDecodeError as error:
        if error.start < len(beginning) - 3:  # the cut may have split the last character
            return None
        text = beginning[: error.start].decode("utf-8")
    if all(character.isprintable() or character.isspace() for character in text):
        return "not an image but a text file", "name the photo itself"
    return None
