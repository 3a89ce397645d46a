"""Between 8-bit sRGB, as files have it, and linear RGB, in which light adds up (IEC 61966-2-1)."""

from __future__ import annotations

import numpy as np

SRGB_STEPS = 2**14  # of the table from linear to sRGB; leaves less than one 8-bit step of error in the darkest tones


def _encode(linear: np.ndarray) -> np.ndarray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


def _decode(encoded: np.ndarray) -> np.ndarray:
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


# Tables are several times faster than a power for every pixel.
_LINEAR_OF_SRGB = _decode(np.arange(256) / 255.0).astype(np.float32)
SRGB_OF_LINEAR = np.round(255.0 * _encode(np.arange(SRGB_STEPS) / (SRGB_STEPS - 1))).astype(np.uint8)


def to_linear(color: np.ndarray) -> np.ndarray:
    """Linear RGB in [0, 1], float32, of 8-bit sRGB."""
    return _LINEAR_OF_SRGB[color]


def to_srgb(color: np.ndarray) -> np.ndarray:
    """8-bit sRGB of linear RGB; clipped to [0, 1]."""
    return SRGB_OF_LINEAR[np.rint(np.clip(color, 0.0, 1.0) * (SRGB_STEPS - 1)).astype(np.int32)]
