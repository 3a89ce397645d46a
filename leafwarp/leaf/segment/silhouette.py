"""Which part of the picture is the leaf.

A picture is looked at small first: the border shows the background's colours (``background``), several
channels each give a guess at what stands before it, and the guesses are scored (``candidates``,
``pieces``). The best one, where it looks like a leaf (``likeness``), is then worked out on a larger raster: petiole and
leaflets, margin, holes (``refine``). A picture in which none of this is clear is refused rather than meshed wrongly.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from leafwarp.errors import InputError
from leafwarp.leaf.image.photo import Photo
from leafwarp.leaf.segment.background import Background, background_of, colour_distance, is_grey
from leafwarp.leaf.segment.candidates import LEAST_THRESHOLD, Guess, agreement, choose, guesses
from leafwarp.leaf.segment.growth import grow
from leafwarp.leaf.segment.holes import find_holes
from leafwarp.leaf.segment.likeness import Evidence, evidence, leafy
from leafwarp.leaf.segment.pieces import COMPARABLE, border_contact, cut_share, filled, largest_piece, pieces_of
from leafwarp.leaf.segment.refine import cleaned, margin
from leafwarp.leaf.segment.shadow import without_shadow

WORK_SIDE = 1024  # [pixels] bound of the long side of what is looked at
LOOK_SIDE = 512  # [pixels] the same for the first look
FULL_SIDE = 2048  # [pixels] bound of the whole picture's raster where only a part of it is looked at
LEAST_CONFIDENCE = 0.55  # below it a picture is refused
SURE = 0.75  # the same where less is known of the background
MOST_PIECES = 6  # of like size in a picture of leaves
CROWDED = 0.4  # share of the confidence that more of them leave
LEAST_OTHER = 0.1  # of the leaf's area: a smaller leaf beside it is not worth a word
CLEAR = 0.5  # least share of a piece beside the leaf that is neither background nor its shadow
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
        confidence: How sure this is the leaf, in [0, 1]; 1 where it was given by a mask. Opacity gives the shape, not
            the word that it is a leaf's.
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
        InputError: No leaf stands out, no background is left, it is not sure what the leaf is, what the opacity shows
            does not look like one, or the rectangle is not one of the photo.
    """
    import cv2

    opacity = mask is None and photo.alpha is not None
    if opacity:
        mask, mask_path = photo.alpha / np.float32(255.0), mask_path or photo.path
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
        field, holes = _of_mask(given, mask_path or photo.path, "opacity" if opacity else "mask")
        confidence, notes = 1.0, []
    if mask is None or opacity:
        colour = cv2.resize(photo.colour, size, interpolation=cv2.INTER_AREA)[part]
    if mask is None:
        field, holes, confidence, notes = _of_colours(photo, colour)
    elif opacity:
        confidence, notes = _judged_opacity(photo, colour, field > 0.0, given > 0.0)
    return Silhouette(
        _placed(field, part, size, -1.0),
        scale,
        None if holes is None else _placed(holes, part, size, False),
        confidence,
        tuple(notes),
    )


Found = tuple[np.ndarray, np.ndarray | None, float, list[str]]


def _of_mask(given: np.ndarray, path: Path, named: str) -> tuple[np.ndarray, np.ndarray | None]:
    """Field and holes of a mask in [-1, 1]."""
    seen = largest_piece(given > 0.0)
    if np.count_nonzero(seen) < 16:
        raise InputError(f"{path}: {named}: no leaf in it; accepted: a {named} that is light on the leaf")
    inside = filled(seen)
    if inside.all():
        raise InputError(f"{path}: {named}: all of it is leaf; accepted: a {named} that is dark off the leaf")
    labels, areas = pieces_of(inside & ~seen)
    holes = (areas >= max(0.001 * np.count_nonzero(inside), 4))[labels]
    field = np.where(inside, np.maximum(given, 0.25), np.minimum(given, -0.25))
    return np.clip(field, -1.0, 1.0).astype(np.float32), holes if holes.any() else None


def _judged_opacity(
    photo: Photo, colour: np.ndarray, inside: np.ndarray, opaque: np.ndarray
) -> tuple[float, list[str]]:
    """Confidence and notes of the leaf that a picture's opacity shows: its shape is trusted, but icons have one too.

    Args:
        photo: For messages.
        colour: 8-bit RGB, shape [height, width, 3].
        inside: The largest piece, holes filled, shape [height, width], bool.
        opaque: All that the opacity shows, of the same shape.
    """
    lab = _lab(colour)
    # What colour transparent pixels have says nothing; the frame of a cut-out is no border that could cut a leaf.
    seen = evidence(lab, inside, is_grey(lab[inside & opaque][None]), 0.0)
    areas = pieces_of(opaque)[1]
    count = int(np.count_nonzero(areas > COMPARABLE * areas.max()))
    confidence = seen.likeness * (1.0 if count <= MOST_PIECES else CROWDED)
    if confidence < LEAST_CONFIDENCE:
        raise InputError(
            f"{photo.path}: opacity: what it shows does not look like a leaf "
            f"({_why(confidence, LEAST_CONFIDENCE, seen)}); accepted: a picture opaque on one leaf, or leaf.mask "
            "(a picture light on the leaf)"
        )
    return confidence, _doubt_notes(confidence, seen) + _count_notes(count)


def _why(confidence: float, needed: float, seen: Evidence) -> str:
    """A confidence that is too low, and what speaks against a leaf."""
    return f"confidence {confidence:.2f}; needed: {needed}" + (f"; it is {seen.against}" if seen.against else "")


def _doubt_notes(confidence: float, seen: Evidence) -> list[str]:
    """What speaks against a leaf that is taken with less confidence than is usual."""
    if confidence >= SURE or not seen.against:
        return []
    return [f"confidence {confidence:.2f}: it is {seen.against}; a leaf all the same?"]


def _count_notes(count: int) -> list[str]:
    if count < 2:
        return []
    return [f"{count} leaves seen, the largest is taken: leaf.rect = [x, y, width, height] picks another"]


def _of_colours(photo: Photo, colour: np.ndarray) -> Found:
    """Field, holes, confidence and notes of a picture, 8-bit RGB."""
    import cv2

    small = _shrunk(colour, LOOK_SIDE)
    look = _lab(small)
    guess, rivals, background, confidence, judged = _best_guess(photo, look)
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
    notes = _doubt_notes(confidence, judged)
    if cut > MOST_CUT:
        raise InputError(f"{photo.path}: the leaf is cut off by the picture ({cut:.0%} of its outline); {REMEDY}")
    if cut > NOTED_CUT:
        notes.append(f"{cut:.0%} of the leaf's outline lies on the picture's border: it may be cut off there")
    elif cut > 0.0:
        notes.append("the leaf runs up to the picture's border: its petiole or a tip may be cut off there")
    notes += _count_notes(_leaf_count(guess, look, inside, background))
    return field, find_holes(lab, inside, background), confidence, notes


def _leaf_count(guess: Guess, look: np.ndarray, inside: np.ndarray, background: Background) -> int:
    """Leaves in the picture: the one taken and all pieces beside it that are about as large and leaf-coloured.

    Args:
        guess: The guess that was taken, with all else that was seen.
        look: The picture of the first look, Lab.
        inside: The leaf as it was worked out, leaflets and petiole included, on any raster.
        background: Its background.
    """
    import cv2

    size = (look.shape[1], look.shape[0])
    leaf = cv2.resize(inside.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.0
    # A guess in one channel may not see a leaf of another colour, so all that differs from the background is asked.
    limit = max(1.3 * background.grain, LEAST_THRESHOLD)
    clear = colour_distance(look, background.shades(0.2)) > limit
    labels, areas = pieces_of(cv2.morphologyEx((clear | guess.seen).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3))))
    areas[np.unique(labels[leaf])] = 0
    count = 1
    for label in np.flatnonzero(areas >= LEAST_OTHER * np.count_nonzero(leaf)):
        piece = labels == label
        whole = border_contact(piece) < 0.1 and (background.grey or leafy(look, piece)) and clear[piece].mean() > CLEAR
        count += bool(whole and evidence(look, piece, background.grey, cut_share(piece)).likeness >= LEAST_CONFIDENCE)
    return count


def _best_guess(photo: Photo, look: np.ndarray) -> tuple[Guess, list[np.ndarray], Background, float, Evidence]:
    """The best guess at the leaf, others at the same blade, the background they were made with, how sure it is and what
    speaks against it.

    Where the colours seen on three sides of the picture do not lead to a leaf (a sheet of paper that is not as wide
    as the picture), those seen on two or one are taken for background too.
    """
    reason, most = "nothing stands out from the background", -1.0
    for sides in (3, 2, 1):
        background = background_of(look, sides)
        found = guesses(look, background)
        if not found:
            continue
        guess, support = choose(found)
        seen = evidence(look, guess.inside, background.grey, cut_share(guess.inside), background.colours)
        cut_out = _cut_out(guess, support, background)
        confidence = cut_out * seen.likeness
        if _fills_picture(guess, look, background):
            raise InputError(f"{photo.path}: no background found (a leaf seems to fill the picture); {REMEDY}")
        needed = LEAST_CONFIDENCE if sides == 3 else SURE
        if confidence >= needed:
            return guess, _rivals(guess, found), background, confidence, seen
        if cut_out > most:
            reason, most = _why(confidence, needed, seen), cut_out
    raise InputError(f"{photo.path}: no leaf found for sure ({reason}); {REMEDY}")


def _rivals(guess: Guess, found: list[Guess]) -> list[np.ndarray]:
    """Guesses at the same blade that have more to it: its petiole may be among that."""
    alike = [other.inside for other in found if SAME_BLADE < agreement(guess.inside, other.inside) < 1.0]
    more = [np.count_nonzero(other & ~guess.inside) for other in alike]
    return [alike[index] for index in np.argsort(more)[::-1][:MOST_RIVALS] if more[index] > 0]


def _cut_out(guess: Guess, support: float, background: Background) -> float:
    """How sure a guess is one thing before a background, whatever it is, in [0, 1]."""
    sure = guess.score * min(1.0, (support / 0.8) ** 2)
    sure *= float(np.clip((16.0 - background.grain) / 7.0, 0.0, 1.0))  # a border of all colours explains anything
    sure *= float(np.clip((guess.calm + 0.1) / 0.5, 0.0, 1.0))  # as strong edges outside: clutter
    sure *= min(1.0, guess.edge / 0.6)  # a soft blob
    sure *= 1.0 if guess.count <= MOST_PIECES else CROWDED  # bricks, pebbles, letters
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
