"""Pictures as PNG."""

from __future__ import annotations

import numpy as np


def encode_png(image: np.ndarray) -> bytes:
    """The bytes of a PNG file.

    Args:
        image: 8-bit RGB or RGBA, top row first, shape [height, width, 3 or 4].

    Raises:
        ValueError: The array is no such picture.
    """
    import cv2

    codes = {3: cv2.COLOR_RGB2BGR, 4: cv2.COLOR_RGBA2BGRA}
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] not in codes or not image.size:
        raise ValueError(f"image: shape {image.shape}, {image.dtype} given; accepted: [height, width, 3 or 4], uint8")
    done, encoded = cv2.imencode(".png", cv2.cvtColor(image, codes[image.shape[2]]))
    if not done:
        raise ValueError(f"image: shape {image.shape} cannot be encoded as PNG")
    return encoded.tobytes()
