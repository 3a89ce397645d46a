"""From a guess at the leaf to its margin, its petiole and leaflets, and its holes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leafwarp.leaf.segment.background import WEIGHT, Background, colour_distance
from leafwarp.leaf.segment.candidates import LEAST_THRESHOLD, is_grey
from leafwarp.leaf.segment.pieces import filled, largest_piece, pieces_of

BAND = 3  # [pixels] on either side of a guess's contour within which the margin is looked for
REACH = 7.0  # [pixels] over which the colours on either side of the margin are gathered
LEAST_STEP = 8.0  # [Lab units] between both sides, below which the guess's contour stands
LEAST_LIGHT = 30.0  # [Lab units] of leaf and background, for a shadow to be told from them
DARKER = 0.5  # lightness of a hard shadow over theirs
MOST_SHADOW = 0.4  # of a guess; more is a dark leaf
MIXED = 7.0  # [Lab units] from the line between a shadow's colour and the background's
GAP = 0.08  # of the square root of a leaf's area: shadow between it and its petiole
NOISES = 4.0  # standard deviations of the background above which something is seen
LEAST_DIFFERENCES = (5.0, 3.0, 3.0)  # [Lab units] of lightness, a and b that a petiole shows
PATTERN = 2.0  # times a petiole's area: more of its like elsewhere makes it a part of the background
ALIKE = 0.6  # of a petiole's width: narrower things are not of its like
LEADING = 0.4  # least reach of a petiole as a share of its length: it starts in a sinus, a margin's rim does not leave
SLENDER = 2.0  # least reach of a petiole in its widths
PLAIN_LENGTHS = (6.0, 0.2)  # least reach of a blade's part that is plainly its petiole: in widths, and of its size
RIM = 2.5  # [pixels] off a blade over which what is seen may be its own blurred margin
LIKE_BLADE = 30.0  # [Lab units] farthest that a leaflet's colour is from the blade's
LOST = 0.003  # of a leaf
HOLE_SHARE = 0.001  # of the leaf; less is dirt or glare
CORE = 0.2  # least share of a hole that is plainly background; glare has less
SHARP = 0.5  # colour step at a hole's rim, as a share of the leaf's contrast; glare fades slowly


def margin(lab: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The leaf as a field, zero half way between the colours on either side of its margin.

    Near the contour each pixel's colour is placed on the line from the mean colour outside to the mean colour
    inside, both taken nearby (closed-form matting with known sides): this finds the margin below a pixel and moves a
    contour that a global threshold left a little off.

    Args:
        lab: The picture in Lab, shape [height, width, 3].
        inside: A guess, right to a few pixels.

    Returns:
        Positive on the leaf, in [-1, 1], float32.
    """
    import cv2

    rows, columns = np.nonzero(inside)
    pad = 4 * BAND + int(2 * REACH)
    box = np.s_[max(rows.min() - pad, 0) : rows.max() + pad + 1, max(columns.min() - pad, 0) : columns.max() + pad + 1]
    field = np.full(inside.shape, -1.0, np.float32)
    shape, colour = inside[box], lab[box] * WEIGHT
    depth = _distance(shape) - _distance(~shape)
    core = (np.abs(depth) > BAND).astype(np.float32)
    sides = []
    for side in (shape, ~shape):
        weight = core * side
        total = cv2.GaussianBlur(weight, (0, 0), REACH)
        sides.append((cv2.GaussianBlur(colour * weight[..., None], (0, 0), REACH) / (total[..., None] + 1e-6), total))
    (leaf, leaf_weight), (ground, ground_weight) = sides
    line = leaf - ground
    step = np.sqrt((line**2).sum(axis=2))
    share = ((colour - ground) * line).sum(axis=2) / np.maximum(step**2, 1e-3)
    known = (leaf_weight > 0.02) & (ground_weight > 0.02) & (step > LEAST_STEP) & (np.abs(depth) <= BAND)
    plain = np.clip((depth - np.sign(depth) * 0.5) / 1.5, -1.0, 1.0)
    field[box] = np.where(known, np.clip(2.0 * share - 1.0, -1.0, 1.0), plain)
    return field


def without_shadow(lab: np.ndarray, inside: np.ndarray, background: Background) -> np.ndarray:
    """A guess without the cast shadow at its margin.

    Light that came through the leaf tints its shadow, so that no darkened paper explains it. What is then left is
    that a hard shadow is far darker than both leaf and background, and lies between them.
    """
    import cv2

    light = min(float(np.median(lab[inside][:, 0])), float(np.median(background.colours[:, 0])))
    if light < LEAST_LIGHT:
        return inside
    dark = cv2.morphologyEx(
        (inside & (lab[..., 0] < DARKER * light)).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)
    )
    labels, areas = pieces_of(dark > 0)
    rim = cv2.dilate((~inside).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    cast = np.bincount(labels[rim], minlength=len(areas)) > 0.25 * np.sqrt(areas)
    cast &= areas > max(0.0005 * np.count_nonzero(inside), 6)
    cast[0] = False
    zone = cv2.dilate(cast[labels].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    if not zone.any() or np.count_nonzero(zone & inside) > MOST_SHADOW * np.count_nonzero(inside):
        return inside
    # The shadow's own rim mixes its colour with the background's.
    mean = np.median(lab[zone], axis=0)
    share = np.linspace(0.0, 1.0, 6)[:, None, None]
    mixes = (mean + share * (background.colours - mean)).reshape(-1, 3)
    near = cv2.dilate(zone.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    rim = near & (colour_distance(lab, mixes) < max(background.grain, MIXED))
    return _rejoined(inside & ~zone & ~rim)


def _rejoined(lit: np.ndarray) -> np.ndarray:
    """The largest piece and those that a shadow a few pixels wide parted from it."""
    import cv2

    labels, areas = pieces_of(lit)
    main = int(np.argmax(areas))
    joined = (labels == main).astype(np.uint8)
    gap, nearest = cv2.distanceTransformWithLabels(1 - joined, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    rows, columns = np.nonzero(joined)
    place = np.zeros((nearest.max() + 1, 2), int)
    place[nearest[rows, columns]] = np.column_stack([columns, rows])
    for label in np.nonzero(areas > 0.004 * areas[main])[0]:
        piece = labels == label
        if label == main or gap[piece].min() > max(4.0, GAP * np.sqrt(areas[main])):
            continue
        row, column = np.unravel_index(np.argmin(np.where(piece, gap, np.inf)), gap.shape)
        joined |= piece.astype(np.uint8)
        cv2.line(joined, (int(column), int(row)), place[nearest[row, column]].tolist(), 1, 3)
    return joined > 0


def grow(
    lab: np.ndarray,
    blade: np.ndarray,
    likely: np.ndarray,
    cast: np.ndarray,
    background: Background,
    rivals: Sequence[np.ndarray] = (),
) -> np.ndarray:
    """A blade with its petiole and its leaflets.

    Thin things that differ from the background nearby are looked for one channel at a time; what hangs on the
    blade by them, is no shadow and is not of the background's own colours (grid lines) belongs to the leaf. A
    petiole that none of the channels shows is looked for in other guesses at the same blade.

    Args:
        lab: The picture in Lab, shape [height, width, 3].
        blade: The blade, bool.
        likely: Other pieces that differ from the background; those of the blade's colour may be leaflets.
        cast: What was taken off the blade as its shadow: no petiole is looked for in it.
        background: The background's colours.
        rivals: Other guesses at the leaf, bool, of the blade's shape.
    """
    import cv2

    size = float(np.sqrt(np.count_nonzero(blade)))
    radius = max(2, round(0.05 * size))
    small_disc = _disc(max(1, round(0.012 * size)))
    shadow = colour_distance(lab, background.shades(0.2, is_grey(lab))) < max(0.8 * background.grain, 4.0)
    ground = cv2.dilate((blade | likely).astype(np.uint8), np.ones((7, 7), np.uint8)) == 0
    leaflets = _leaflets(lab, blade, likely)
    away = _distance(~blade)
    stalks, links = [], np.zeros_like(blade)
    for channel, least in zip(cv2.split(lab), LEAST_DIFFERENCES, strict=True):
        difference, noise = _against_near(channel, ground, 2.0 * radius)
        for sign in (1.0, -1.0):
            seen = (sign * difference > max(NOISES * noise, least)) & ~blade & ~cast
            lit = cv2.morphologyEx((seen & ~shadow).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
            # What lies between lit parts is a stalk's brown middle, not shadow.
            between = seen & (cv2.morphologyEx(lit, cv2.MORPH_CLOSE, small_disc) > 0)
            thin = _thin(((lit > 0) & ~shadow & ~blade & ~cast) | between, radius)
            stalks += _stalks(thin & ~leaflets, away, size)
            if leaflets.any():
                links |= _links(thin & ~leaflets, blade, leaflets)
    if not stalks:
        for rival in rivals:
            stalks += _single(_stalks(_thin(rival & ~blade & ~cast & ~leaflets, radius), away, size))
    stalks = _besides_own(stalks, blade, away, radius)
    return largest_piece(blade | _petiole(stalks, away) | leaflets | links, seed=blade)


def _besides_own(stalks: list[np.ndarray], blade: np.ndarray, away: np.ndarray, radius: int) -> list[np.ndarray]:
    """Of the stalks those that go on from the end of the petiole that the blade has already, or are longer than it.

    That petiole is the one long thin line that the blade ends in; where there is none or several, all stalks stay.
    """
    thin = _thin(blade, radius)
    core = blade & ~thin
    if not stalks or not core.any():
        return stalks
    size = float(np.sqrt(np.count_nonzero(blade)))
    labels, areas = pieces_of(thin, connectivity=8)
    label_of, from_core = labels[thin], _distance(~core)
    widths = np.bincount(label_of, _distance(thin)[thin], minlength=len(areas)) / np.maximum(areas, 1)
    widths = np.maximum(4.0 * widths - 2.0, 1.0)
    reaches = np.zeros(len(areas))
    np.maximum.at(reaches, label_of, from_core[thin])
    plain = reaches > np.maximum(PLAIN_LENGTHS[0] * widths, PLAIN_LENGTHS[1] * size)
    plain &= areas < 1.7 * (reaches + widths) * widths
    if np.count_nonzero(plain) != 1:
        return stalks
    own = int(np.argmax(plain))
    gap = _distance(~((labels == own) & (from_core > 0.9 * reaches[own])))
    return [stalk for stalk in stalks if gap[stalk].min() <= RIM + 2.0 or float(away[stalk].max()) > reaches[own]]


def _petiole(stalks: list[np.ndarray], away: np.ndarray) -> np.ndarray:
    """The largest of the stalks that reach about farthest."""
    reaches = [float(away[stalk].max()) for stalk in stalks]
    far = [stalk for stalk, reach in zip(stalks, reaches, strict=True) if reach > 0.8 * max(reaches)]
    return max(far, key=np.count_nonzero, default=np.zeros(away.shape, bool))


def _single(stalks: list[np.ndarray]) -> list[np.ndarray]:
    """The stalks of a guess, or none where several hang on the blade: those are a pattern of the background."""
    if not stalks:
        return []
    _, areas = pieces_of(np.logical_or.reduce(stalks), connectivity=8)
    return stalks if np.count_nonzero(areas > 0.3 * areas.max()) == 1 else []


def find_holes(lab: np.ndarray, inside: np.ndarray, background: Background) -> np.ndarray | None:
    """Holes of a filled leaf through which the background shows, shape as the leaf's, or None.

    Args:
        lab: The picture in Lab, shape [height, width, 3].
        inside: The leaf, holes filled.
        background: The background's colours.
    """
    import cv2

    distance = colour_distance(lab, background.shades(0.3, is_grey(lab)))
    least = max(1.4 * background.grain, LEAST_THRESHOLD)
    contrast = float(np.median(distance[inside]))
    if contrast < 1.5 * least:
        return None
    kernel = np.ones((5, 5), np.uint8)
    deep = cv2.erode(inside.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    light = min(float(np.median(lab[inside][:, 0])), float(np.median(background.colours[:, 0])))
    # Beneath a leaf lies its shadow: dark parts count with a hole, but do not make one.
    dark = lab[..., 0] < DARKER * light
    lit = colour_distance(lab, background.shades(0.5, is_grey(lab)))
    step = cv2.dilate(distance, kernel) - cv2.erode(distance, kernel)
    holes = np.zeros_like(inside)
    for level in (0.5 * (least + contrast), 1.2 * least):  # the second parts a hole from glare beside it
        seen = cv2.morphologyEx((((distance < level) | dark) & deep).astype(np.uint8), cv2.MORPH_OPEN, kernel[:3, :3])
        labels, areas = pieces_of(seen > 0)
        core = np.bincount(labels[lit < least], minlength=len(areas))
        large = (areas >= max(HOLE_SHARE * np.count_nonzero(inside), 12)) & (core > CORE * areas)
        for label in np.nonzero(large)[0]:
            piece = labels == label
            rim = piece & (cv2.erode(seen, kernel[:3, :3]) == 0)
            if np.median(step[rim]) > SHARP * contrast and not (piece & holes).any():
                holes |= piece
    return holes if holes.any() else None


def _leaflets(lab: np.ndarray, blade: np.ndarray, likely: np.ndarray) -> np.ndarray:
    """Pieces besides the blade that are of its colours."""
    labels, areas = pieces_of(likely & ~blade)
    typical = np.median(lab[blade], axis=0)
    kept = np.zeros(len(areas), bool)
    for label in np.nonzero(areas > 0.002 * np.count_nonzero(blade))[0]:
        colour = np.median(lab[labels == label], axis=0)
        kept[label] = np.linalg.norm((colour - typical) * WEIGHT) < LIKE_BLADE
    return kept[labels]


def _thin(seen: np.ndarray, radius: int) -> np.ndarray:
    """The parts of a mask in which no disc of a radius has room."""
    core = _distance(seen) > radius
    return seen & (_distance(~core) > radius) if core.any() else seen


def _disc(radius: int) -> np.ndarray:
    import cv2

    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))


def _stalks(thin: np.ndarray, away: np.ndarray, size: float) -> list[np.ndarray]:
    """Of thin things those that hang on a blade as its petiole does: one line that leads away from it.

    They are looked for as they are, and without what is one or two pixels wide: grid lines that cross a petiole.

    Args:
        thin: The things.
        away: Distance of each pixel to the blade [pixels].
        size: The blade's [pixels].
    """
    import cv2

    broad = cv2.morphologyEx(thin.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    return [
        stalk | (thin & (away <= RIM + 1.0) & (cv2.dilate(stalk.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0))
        for mask in (thin, broad)
        for stalk in _lines(mask & (away > RIM), away, size)
    ]


def _lines(thin: np.ndarray, away: np.ndarray, size: float) -> list[np.ndarray]:
    """Of thin things off a blade's rim those that are one line, begin at the rim and lead away from it."""
    labels, areas = pieces_of(thin, connectivity=8)
    label_of = labels[thin]
    depth = np.bincount(label_of, _distance(thin)[thin], minlength=len(areas))
    widths = np.maximum(4.0 * depth / np.maximum(areas, 1) - 2.0, 1.0)
    touches = np.bincount(label_of, away[thin] <= RIM + 2.0, minlength=len(areas)) > 0
    kept = []
    for label in np.nonzero(touches & (areas > 6))[0]:
        # Much of the like elsewhere is a pattern of the background: grid lines, grain of wood.
        elsewhere = areas[~touches & (widths > ALIKE * widths[label])].sum()
        width, area = widths[label], areas[label]
        if area <= elsewhere / PATTERN or area < 0.03 * size * width:
            continue
        piece = labels == label
        reach = float(away[piece].max())
        sides = sum(bool(side.any()) for side in (piece[0], piece[-1], piece[:, 0], piece[:, -1]))
        rows, columns = piece.any(axis=1).nonzero()[0], piece.any(axis=0).nonzero()[0]
        length = max(reach, float(np.hypot(np.ptp(rows), np.ptp(columns))))
        # A net of lines (graph paper, grass) has much more area than its length and width make.
        one_line = area < 1.7 * (length + width) * width
        leads_away = reach > max(SLENDER * width, LEADING * length, 0.03 * size)
        if one_line and leads_away and reach < 2.0 * size and sides < 2:
            kept.append(piece)
    return kept


def _links(thin: np.ndarray, blade: np.ndarray, leaflets: np.ndarray) -> np.ndarray:
    """Of thin things those that join leaflets to each other or to the blade."""
    import cv2

    kernel = np.ones((5, 5), np.uint8)
    blades, _ = pieces_of(blade | leaflets)
    labels, areas = pieces_of(thin, connectivity=8)
    near = cv2.dilate(blades.astype(np.float32), kernel).astype(int) * thin
    touching = near > 0
    first, last = np.full(len(areas), blades.max() + 1), np.zeros(len(areas), int)
    np.minimum.at(first, labels[touching], near[touching])
    np.maximum.at(last, labels[touching], near[touching])
    joins = first < last
    wide = cv2.dilate(joins[labels].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return wide if joins.any() else joins[labels]


def _against_near(channel: np.ndarray, ground: np.ndarray, sigma: float) -> tuple[np.ndarray, float]:
    """A channel less its mean over the ground nearby (0 where there is none), and the ground's noise."""
    import cv2

    factor = max(1, int(sigma / 4.0))
    size = (channel.shape[1], channel.shape[0])
    small = (-(-size[0] // factor), -(-size[1] // factor))
    parts = [cv2.resize(part, small, interpolation=cv2.INTER_AREA) for part in (channel * ground, ground * 1.0)]
    total, weight = (
        cv2.resize(cv2.GaussianBlur(part.astype(np.float32), (0, 0), sigma / factor), size) for part in parts
    )
    difference = np.where(weight > 0.01, channel - total / np.maximum(weight, 1e-4), 0.0)
    seen = np.abs(difference[ground])
    return difference, 1.4826 * float(np.median(seen)) if len(seen) else np.inf


def _distance(mask: np.ndarray) -> np.ndarray:
    import cv2

    return cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)


def _bridged(field: np.ndarray, leaf: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """A field with its largest lost piece joined to the rest by the shortest way through the leaf."""
    lost = largest_piece((field > 0.0) & leaf & ~inside)
    if np.count_nonzero(lost) <= LOST * np.count_nonzero(inside):
        return field
    way = np.where(leaf, _distance(~lost) + _distance(~inside), np.inf)
    return np.where(way <= way.min() + 1.0, np.maximum(field, 0.1), field)


def cleaned(field: np.ndarray, leaf: np.ndarray) -> np.ndarray:
    """A field whose positive part is one piece without holes: that of the leaf.

    Where a thin link that the leaf had (a petiole's foot in shadow) is lost in the field, it is put back.
    """
    import cv2

    inside = largest_piece(field > 0.0, seed=leaf)
    if np.count_nonzero((field > 0.0) & leaf & ~inside) > LOST * np.count_nonzero(inside):
        depth = _distance(leaf)
        ridge = leaf & (depth >= cv2.dilate(depth, np.ones((3, 3), np.uint8)) - 0.5) & (depth <= BAND)
        ridge = leaf & (cv2.dilate(ridge.astype(np.uint8), np.ones((2, 2), np.uint8)) > 0)  # joined by sides
        field = np.where(ridge, np.maximum(field, 0.1), field)
        field = _bridged(field, leaf, largest_piece(field > 0.0, seed=leaf))
        inside = largest_piece(field > 0.0, seed=leaf)
    inside = filled(inside)
    # The sign follows the cleaned shape, the magnitude keeps the sub-pixel position of the margin.
    return np.where(inside, np.maximum(field, 0.05), np.minimum(field, -0.05)).astype(np.float32)
