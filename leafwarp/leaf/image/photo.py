"""Reading an image file into 8-bit RGB, or refusing it with one line that says why."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.image.decode import decode
from leafwarp.leaf.image.header import BrokenImage, ImageHeader, read_header

ACCEPTED = "PNG, JPEG, TIFF or WebP"
MAXIMUM_PIXELS = 150_000_000
MAXIMUM_BYTES = 2_000_000_000
MINIMUM_SIDE = 32


@dataclass(frozen=True)
class Photo:
    """A decoded picture, upright.

    Attributes:
        path: Where it came from, for messages.
        colour: 8-bit RGB, top row first, shape [height, width, 3].
        alpha: Opacity 0 to 255, shape [height, width], or None where the file has none (or a constant one).
    """

    path: Path
    colour: np.ndarray
    alpha: np.ndarray | None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.colour.shape[1], self.colour.shape[0]


def read_bytes(path: Path) -> bytes:
    """The bytes of an image file.

    Raises:
        InputError: The file is missing, a folder, empty, unreadable or larger than any photo.
    """
    path = Path(path)
    try:
        if not path.exists():
            raise InputError(f"{path}: no such file; accepted: a {ACCEPTED} image")
        if not path.is_file():
            kind = "a folder" if path.is_dir() else "not a regular file"
            raise InputError(f"{path}: is {kind}; accepted: a {ACCEPTED} image")
        if path.stat().st_size > MAXIMUM_BYTES:
            raise InputError(f"{path}: is {path.stat().st_size} bytes; accepted: at most {MAXIMUM_BYTES}")
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not data:
        raise InputError(f"{path}: is empty; accepted: a {ACCEPTED} image")
    return data


def read_photo(path: Path, data: bytes | None = None, minimum_side: int = MINIMUM_SIDE) -> Photo:
    """Read a picture upright as 8-bit RGB with its opacity.

    Grey, palette, CMYK, 16-bit and float files are converted; the EXIF orientation is applied. An opacity that is
    the same everywhere says nothing about the leaf and is left out.

    Args:
        path: A PNG, JPEG, TIFF or WebP file.
        data: Its bytes, where they are at hand.
        minimum_side: Least width and height accepted, in pixels.

    Raises:
        InputError: The file is no image, incomplete, corrupt, an animation, transparent everywhere, too small or
            larger than 150 megapixels. The declared size is checked before anything is decoded.
    """
    colour, alpha = _colour_and_alpha(_eight_bit(_read_pixels(Path(path), data, minimum_side)))
    if alpha is not None and not alpha.any():
        raise InputError(f"{path}: is transparent everywhere; accepted: a picture that is opaque on the leaf")
    return Photo(Path(path), colour, None if alpha is None or alpha.min() == alpha.max() else alpha)


def read_grey(path: Path, data: bytes | None = None) -> np.ndarray:
    """Read a picture as grey in [0, 1], top row first, shape [height, width], float64 (16-bit depth is kept).

    Colour is weighted as luma (0.299, 0.587, 0.114). Raises InputError as :func:`read_photo` does.
    """
    pixels = _read_pixels(Path(path), data, minimum_side=1)
    whole = 1.0 if np.issubdtype(pixels.dtype, np.floating) else np.iinfo(pixels.dtype).max
    grey = pixels if pixels.ndim == 2 else pixels[..., 0]
    if pixels.ndim == 3 and pixels.shape[2] >= 3:
        grey = sum(weight * pixels[..., channel] for channel, weight in enumerate((0.114, 0.587, 0.299)))
    grey = np.nan_to_num(grey / whole, copy=False)
    return np.clip(grey, 0.0, 1.0, out=grey)


def _read_header(path: Path, data: bytes, minimum_side: int) -> ImageHeader:
    """The header of a picture of an accepted format and size."""
    try:
        header = read_header(data)
    except BrokenImage as error:
        remedy = f"{error.remedy}; accepted: " if error.remedy else "accepted: a whole "
        raise InputError(f"{path}: the file {error}; {remedy}{ACCEPTED} image") from error
    size = f"{header.width} x {header.height} pixels"
    if header.width * header.height > MAXIMUM_PIXELS:
        raise InputError(f"{path}: is {size}; accepted: at most {MAXIMUM_PIXELS // 10**6} megapixels")
    if min(header.width, header.height) < minimum_side:
        raise InputError(f"{path}: is {size}; accepted: at least {minimum_side} pixels each way")
    return header


def _read_pixels(path: Path, data: bytes | None, minimum_side: int) -> np.ndarray:
    """Upright pixels as stored (any depth, blue first), the declared size checked before anything is decoded."""
    path = Path(path)
    data = read_bytes(path) if data is None else data
    header = _read_header(path, data, minimum_side)
    try:
        return _upright(decode(data, header), header.orientation)
    except BrokenImage as error:
        remedy = "copy it anew or, if it looks right in an image editor, save it from there"
        raise InputError(f"{path}: the file {error}; {remedy}; accepted: a whole {ACCEPTED} image") from error


def _upright(pixels: np.ndarray, orientation: int) -> np.ndarray:
    """Undo the camera's turn: EXIF orientations 5 to 8 are transposed, then mirrored along one or both axes."""
    if orientation >= 5:
        pixels = pixels.swapaxes(0, 1)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return np.ascontiguousarray(pixels)


def _eight_bit(pixels: np.ndarray) -> np.ndarray:
    if pixels.dtype == np.uint8:
        return pixels
    if np.issubdtype(pixels.dtype, np.floating):
        return (np.clip(np.nan_to_num(pixels), 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    largest = np.iinfo(pixels.dtype).max
    return (np.clip(pixels, 0, largest) * (255.0 / largest) + 0.5).astype(np.uint8)


def _colour_and_alpha(pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    import cv2

    if pixels.ndim == 2:
        return cv2.cvtColor(pixels, cv2.COLOR_GRAY2RGB), None
    channels = pixels.shape[2]
    alpha = np.ascontiguousarray(pixels[..., -1]) if channels in (2, 4) else None
    if channels <= 2:
        return cv2.cvtColor(np.ascontiguousarray(pixels[..., 0]), cv2.COLOR_GRAY2RGB), alpha
    return cv2.cvtColor(pixels, cv2.COLOR_BGRA2RGB if channels == 4 else cv2.COLOR_BGR2RGB), alpha
