"""Which part of the picture is the leaf.

A picture is looked at small first: the border shows the background's colours (``background``), several
channels each give a guess at what stands before it, and the guesses are scored (``candidates``,
``pieces``). The best one is then worked out on a larger raster: petiole and leaflets, margin, holes
(``refine``). A picture in which none of this is clear is refused rather than meshed wrongly.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.image.photo import Photo
from leafwarp.leaf.segment.background import Background, background_of
from leafwarp.leaf.segment.candidates import Guess, agreement, choose, guesses, is_grey
from leafwarp.leaf.segment.pieces import border_contact, cut_share, filled, largest_piece
from leafwarp.leaf.segment.refine import cleaned, find_holes, grow, margin, without_shadow

WORK_SIDE = 1024  # [pixels] bound of the long side of what is looked at
LOOK_SIDE = 512  # [pixels] the same for the first look
FULL_SIDE = 2048  # [pixels] bound of the whole picture's raster where only a part of it is looked at
LEAST_CONFIDENCE = 0.55  # below it a picture is refused
SURE = 0.75  # the same where less is known of the background
MOST_PIECES = 6  # of like size in a picture of leaves
SAME_BLADE = 0.9  # least agreement of two guesses at it
MOST_RIVALS = 6
THIN = 0.06  # half width of veins, as a share of the picture's shorter side
MOST_CUT = 0.42  # share of the outline on the picture's border
NOTED_CUT = 0.01
MOST_BORDER = 0.6  # of the picture's border that a leaf before a background may touch
REMEDY = "accepted: one leaf before a plain background, or leaf.mask (a picture light on the leaf), or leaf.rect"


@dataclass(frozen=True)
class Silhouette:
    """The leaf's shape as a smooth field.

    Attributes:
        field: Positive on the leaf (its holes are filled), negative off it, in [-1, 1], top row first, shape
            [height, width], float32.
        scale: Photo pixels per pixel of the field, (x, y).
        holes: Pixels inside through which the background shows, bool, of the field's shape; None for none.
        confidence: How sure this is the leaf, in [0, 1]; 1 where it was given by a mask.
        notes: One-line sentences for the user.
    """

    field: np.ndarray
    scale: tuple[float, float]
    holes: np.ndarray | None = None
    confidence: float = 1.0
    notes: tuple[str, ...] = ()

    @property
    def inside(self) -> np.ndarray:
        """The leaf's pixels, holes filled, shape [height, width], bool."""
        return self.field > 0.0


def silhouette(
    photo: Photo,
    mask: np.ndarray | None = None,
    mask_path: Path | None = None,
    rect: tuple[float, float, float, float] | None = None,
) -> Silhouette:
    """The leaf of a photo.

    Args:
        photo: The picture; where it has an opacity and no mask is given, the opacity is the mask.
        mask: Optional grey picture in [0, 1] of the same frame (any size), above 0.5 on the leaf.
        mask_path: Where the mask came from, for messages.
        rect: Left, top, width and height in pixels of the upright photo; the leaf is looked for inside it only.

    Raises:
        InputError: No leaf stands out, no background is left, it is not sure what the leaf is, or the rectangle is
            not one of the photo.
    """
    import cv2

    if mask is None and photo.alpha is not None:
        mask, mask_path = photo.alpha / np.float32(255.0), mask_path or photo.path
        named = "opacity"
    else:
        named = "mask"
    box = _checked_rect(photo, rect)
    width, height = photo.size
    shrink = min(1.0, WORK_SIDE / max(box[2:]), FULL_SIDE / max(width, height))
    size = (max(1, round(width * shrink)), max(1, round(height * shrink)))
    scale = (width / size[0], height / size[1])
    left, top = int(box[0] / scale[0]), int(box[1] / scale[1])
    right, bottom = int(np.ceil((box[0] + box[2]) / scale[0])), int(np.ceil((box[1] + box[3]) / scale[1]))
    part = np.s_[top : min(bottom, size[1]), left : min(right, size[0])]
    if mask is not None:
        given = 2.0 * cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA)[part] - 1.0
        found = _of_mask(given, mask_path or photo.path, named)
    else:
        colour = cv2.resize(photo.colour, size, interpolation=cv2.INTER_AREA)[part]
        found = _of_colours(photo, colour)
    field, holes, confidence, notes = found
    return Silhouette(
        _placed(field, part, size, -1.0),
        scale,
        None if holes is None else _placed(holes, part, size, False),
        confidence,
        tuple(notes),
    )


Found = tuple[np.ndarray, np.ndarray | None, float, list[str]]


def _of_mask(given: np.ndarray, path: Path, named: str) -> Found:
    """Field, holes, confidence and notes of a mask in [-1, 1]."""
    from leafwarp.leaf.segment.pieces import pieces_of

    seen = largest_piece(given > 0.0)
    if np.count_nonzero(seen) < 16:
        raise InputError(f"{path}: {named}: no leaf in it; accepted: a {named} that is light on the leaf")
    inside = filled(seen)
    if inside.all():
        raise InputError(f"{path}: {named}: all of it is leaf; accepted: a {named} that is dark off the leaf")
    labels, areas = pieces_of(inside & ~seen)
    holes = (areas >= max(0.001 * np.count_nonzero(inside), 4))[labels]
    field = np.where(inside, np.maximum(given, 0.25), np.minimum(given, -0.25))
    return np.clip(field, -1.0, 1.0).astype(np.float32), holes if holes.any() else None, 1.0, []


def _of_colours(photo: Photo, colour: np.ndarray) -> Found:
    """Field, holes, confidence and notes of a picture, 8-bit RGB."""
    import cv2

    small = _shrunk(colour, LOOK_SIDE)
    look = _lab(small)
    guess, rivals, background, confidence = _best_guess(photo, look)
    size = (colour.shape[1], colour.shape[0])
    lab = look if size == (small.shape[1], small.shape[0]) else _lab(colour)
    blade, seen, *others = (
        cv2.resize(part.astype(np.float32), size, interpolation=cv2.INTER_LINEAR) > 0.5
        for part in (guess.inside, guess.seen, *rivals)
    )
    lit = without_shadow(lab, blade, background)
    leaf = filled(grow(lab, lit, seen & (lit | ~blade), blade & ~lit, background, others))
    field = cleaned(margin(lab, leaf), leaf)
    inside = field > 0.0
    cut = cut_share(inside)
    notes = []
    if cut > MOST_CUT:
        raise InputError(f"{photo.path}: the leaf is cut off by the picture ({cut:.0%} of its outline); {REMEDY}")
    if cut > NOTED_CUT:
        notes.append(f"{cut:.0%} of the leaf's outline lies on the picture's border: it may be cut off there")
    elif cut > 0.0:
        notes.append("the leaf runs up to the picture's border: its petiole or a tip may be cut off there")
    if guess.count > 1:
        notes.append(
            f"{guess.count} leaves seen, the largest is taken: leaf.rect = [x, y, width, height] picks another"
        )
    return field, find_holes(lab, inside, background), confidence, notes


def _best_guess(photo: Photo, look: np.ndarray) -> tuple[Guess, list[np.ndarray], Background, float]:
    """The best guess at the leaf, others at the same blade, the background they were made with and how sure it is.

    Where the colours seen on three sides of the picture do not lead to a leaf (a sheet of paper that is not as wide
    as the picture), those seen on two or one are taken for background too.
    """
    reason = "nothing stands out from the background"
    for sides in (3, 2, 1):
        background = background_of(look, sides)
        found = guesses(look, background)
        if not found:
            continue
        guess, support = choose(found)
        confidence = _confidence(guess, support, look, background)
        if _fills_picture(guess, look, background):
            raise InputError(f"{photo.path}: no background found (a leaf seems to fill the picture); {REMEDY}")
        needed = LEAST_CONFIDENCE if sides == 3 else SURE
        if confidence >= needed:
            return guess, _rivals(guess, found), background, confidence
        reason = f"confidence {confidence:.2f}; needed: {needed}"
    raise InputError(f"{photo.path}: no leaf found for sure ({reason}); {REMEDY}")


def _rivals(guess: Guess, found: list[Guess]) -> list[np.ndarray]:
    """Guesses at the same blade that have more to it: its petiole may be among that."""
    alike = [other.inside for other in found if SAME_BLADE < agreement(guess.inside, other.inside) < 1.0]
    more = [np.count_nonzero(other & ~guess.inside) for other in alike]
    return [alike[index] for index in np.argsort(more)[::-1][:MOST_RIVALS] if more[index] > 0]


def _confidence(guess: Guess, support: float, lab: np.ndarray, background: Background) -> float:
    """How sure a guess is the leaf, in [0, 1]."""
    sure = guess.score * min(1.0, (support / 0.8) ** 2)
    sure *= float(np.clip((16.0 - background.grain) / 7.0, 0.0, 1.0))  # a border of all colours explains anything
    sure *= float(np.clip((guess.calm + 0.1) / 0.5, 0.0, 1.0))  # as strong edges outside: clutter
    sure *= min(1.0, guess.edge / 0.6)  # a soft blob
    sure *= 1.0 if guess.count <= MOST_PIECES else 0.4  # bricks, pebbles, letters
    light, green, yellow = np.median(lab[guess.inside], axis=0)
    if not is_grey(lab):
        chroma = np.hypot(green, yellow)
        hue = np.degrees(np.arctan2(yellow, green)) % 360.0
        if chroma > 14.0 and 200.0 < hue < 335.0:  # no leaf is blue
            sure *= 0.4
        if light > 80.0 and chroma < 9.0:  # white paper, a cup, a lamp
            sure *= 0.4
    else:
        sure *= 0.75  # without colour much looks like a leaf
    return float(np.clip(sure, 0.0, 1.0))


def _fills_picture(guess: Guess, lab: np.ndarray, background: Background) -> bool:
    """Whether what a guess takes for background is leaf: a paler thing on a leafy green one is its midrib, and so is a
    thin thing that runs from border to border on it, with its side veins."""
    light, green, yellow = np.median(background.colours, axis=0)
    leafy = (
        light < 85.0 and np.hypot(green, yellow) > 12.0 and 95.0 < np.degrees(np.arctan2(yellow, green)) % 360.0 < 170.0
    )
    paler = np.hypot(*np.median(lab[guess.inside][:, 1:], axis=0)) < np.hypot(green, yellow)
    return border_contact(guess.inside) > MOST_BORDER or bool(leafy and (paler or _crosses_thinly(guess.inside)))


def _crosses_thinly(inside: np.ndarray) -> bool:
    """Whether a thing is thin everywhere and touches several sides of the picture."""
    import cv2

    touched = sum(side.any() for side in (inside[0], inside[-1], inside[:, 0], inside[:, -1]))
    # The rim of the picture is no margin of the thing.
    depth = cv2.distanceTransform(np.pad(inside, 1, mode="edge").astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return touched >= 2 and float(depth.max()) < THIN * min(inside.shape)


def _checked_rect(photo: Photo, rect: tuple[float, float, float, float] | None) -> tuple[float, float, float, float]:
    """The rectangle within the photo."""
    width, height = photo.size
    if rect is None:
        return 0.0, 0.0, float(width), float(height)
    values = np.asarray(rect, float)
    least = 16.0
    if values.shape == (4,) and np.isfinite(values).all():
        left, top = np.maximum(values[:2], 0.0)
        right, bottom = min(values[0] + values[2], width), min(values[1] + values[3], height)
        if right - left >= least and bottom - top >= least:
            return float(left), float(top), float(right - left), float(bottom - top)
    raise InputError(
        f"{photo.path}: rect: value {rect!r} is not accepted; accepted: x, y, width, height in pixels of the photo, "
        f"at least {least:g} x {least:g} of its {width} x {height}"
    )


def _placed(part: np.ndarray, where: tuple[slice, slice], size: tuple[int, int], other: float) -> np.ndarray:
    """A part of the raster put where it belongs."""
    if part.shape == (size[1], size[0]):
        return part
    whole = np.full((size[1], size[0]), other, part.dtype)
    whole[where] = part
    return whole


def _shrunk(colour: np.ndarray, side: int) -> np.ndarray:
    import cv2

    shrink = side / max(colour.shape[:2])
    if shrink >= 1.0:
        return colour
    size = (max(1, round(colour.shape[1] * shrink)), max(1, round(colour.shape[0] * shrink)))
    return cv2.resize(colour, size, interpolation=cv2.INTER_AREA)


def _lab(colour: np.ndarray) -> np.ndarray:
    """8-bit RGB to Lab, sensor noise smoothed by most of a pixel."""
    import cv2

    return cv2.cvtColor(cv2.GaussianBlur(colour, (0, 0), 0.8).astype(np.float32) / 255.0, cv2.COLOR_RGB2Lab)
