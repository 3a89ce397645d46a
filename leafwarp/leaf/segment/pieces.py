"""Connected pieces of a mask: the leaf among them, its holes, its border."""

from __future__ import annotations

import numpy as np

STRAIGHT = 0.93  # share of its bounding rectangle (turned to fit) that a ruler, card or label fills
NEUTRAL = 7.0  # [Lab units] chroma below which a thing is grey
COMPARABLE = 0.3  # share of the largest piece's weight from which another is a leaf too


def pieces_of(mask: np.ndarray, connectivity: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Labels of a mask's connected pieces (0 off it) and their areas [pixels], that of label 0 set to 0."""
    import cv2

    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=connectivity)
    areas = np.bincount(labels.ravel(), minlength=count)
    areas[0] = 0
    return labels, areas


def largest_piece(mask: np.ndarray, seed: np.ndarray | None = None) -> np.ndarray:
    """The largest connected piece of a mask, or the one that shares most pixels with a seed."""
    labels, areas = pieces_of(mask)
    if len(areas) < 2:
        return np.zeros_like(mask, bool)
    if seed is not None:
        areas = np.bincount(labels[mask & seed], minlength=len(areas))
        areas[0] = 0
    return labels == np.argmax(areas)


def filled(inside: np.ndarray) -> np.ndarray:
    """A shape without holes: whatever a flood from outside the picture does not reach."""
    import cv2

    flooded = np.pad(inside.astype(np.uint8), 1)
    cv2.floodFill(flooded, None, (0, 0), 2)
    return flooded[1:-1, 1:-1] != 2


def leaf_piece(mask: np.ndarray, chroma: np.ndarray) -> tuple[np.ndarray, int]:
    """The piece of a mask most likely to be the leaf, and how many pieces of like weight there are.

    The weight is the area, less for what lies on the border and much less for what is a straight-edged rectangle
    or, where other things are coloured, grey (ruler, coin, label).

    Args:
        mask: The pieces.
        chroma: Distance of each pixel's colour from grey [Lab units], of the same shape.
    """
    import cv2

    labels, areas = pieces_of(mask)
    candidates = np.argsort(areas)[::-1][:12]
    candidates = candidates[areas[candidates] >= max(16, 0.1 * areas.max())] if len(areas) > 1 else candidates[:0]
    if len(candidates) == 0:
        return np.zeros_like(mask, bool), 0
    if len(candidates) == 1:
        return filled(labels == candidates[0]), 1
    weights, colours, hulls = [], [], []
    for label in candidates:
        piece = labels == label
        contour = max(cv2.findContours(piece.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0], key=len)
        box = cv2.minAreaRect(contour)[1]
        hull = filled(piece)
        straight = np.count_nonzero(hull) / max((box[0] + 1.0) * (box[1] + 1.0), 1.0)
        weights.append(
            np.count_nonzero(hull) * (1.0 - 0.8 * border_contact(piece)) * (0.1 if straight > STRAIGHT else 1)
        )
        colours.append(float(np.median(chroma[piece])))
        hulls.append(hull)
    weights = np.array(weights, float)
    if max(colours) > NEUTRAL:
        weights *= np.where(np.array(colours) > 0.5 * NEUTRAL, 1.0, 0.15)
    best = int(np.argmax(weights))
    return hulls[best], int(np.count_nonzero(weights > COMPARABLE * weights[best]))


def border_contact(piece: np.ndarray) -> float:
    """Share of the picture's border that a piece lies on."""
    return float(np.concatenate([piece[0], piece[-1], piece[:, 0], piece[:, -1]]).mean())


def cut_share(piece: np.ndarray) -> float:
    """Share of a piece's outline that lies on the picture's border."""
    on_border = sum(np.count_nonzero(side) for side in (piece[0], piece[-1], piece[:, 0], piece[:, -1]))
    padded = np.pad(piece, 1)
    core = padded[1:-1, 1:-1]
    open_side = ~padded[:-2, 1:-1] | ~padded[2:, 1:-1] | ~padded[1:-1, :-2] | ~padded[1:-1, 2:]
    return on_border / max(np.count_nonzero(core & open_side), 1)
