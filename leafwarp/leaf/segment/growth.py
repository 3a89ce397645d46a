"""What hangs on a blade: its petiole and its leaflets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leafwarp.leaf.segment.background import WEIGHT, Background, colour_distance
from leafwarp.leaf.segment.depth import depth_of, disc, thin_parts
from leafwarp.leaf.segment.fine_ends import with_fine_ends
from leafwarp.leaf.segment.pieces import largest_piece, pieces_of

NOISES = 4.0  # standard deviations of the background above which something is seen
LEAST_DIFFERENCES = (5.0, 3.0, 3.0)  # [Lab units] of lightness, a and b that a petiole shows
PATTERN = 2.0  # times a petiole's area: more of its like elsewhere makes it a part of the background
ALIKE = 0.6  # of a petiole's width: narrower things are not of its like
LEADING = 0.4  # least reach of a petiole as a share of its length: it starts in a sinus, a margin's rim does not leave
SLENDER = 2.0  # least reach of a petiole in its widths
PLAIN_LENGTHS = (6.0, 0.2)  # least reach of a blade's part that is plainly its petiole: in widths, and of its size
RIM = 2.5  # [pixels] off a blade over which what is seen may be its own blurred margin
THREAD = 0.03  # most width of a thread or a hair as a share of a blade's size
UNLIKE, MORE_UNLIKE = 0.05, 2.5  # share of the blade, and times that about its midrib, by which halves may differ
MIRRORED, MARGIN_POINTS = 120.0, 48  # size of the blade [pixels] and points of its margin to compare halves with
LIKE_BLADE = 30.0  # [Lab units] farthest that a leaflet's colour is from the blade's


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
    small_disc = disc(max(1, round(0.012 * size)))
    shadow = colour_distance(lab, background.shades(0.2)) < max(0.8 * background.grain, 4.0)
    ground = cv2.dilate((blade | likely).astype(np.uint8), np.ones((7, 7), np.uint8)) == 0
    leaflets = _leaflets(lab, blade, likely)
    away = depth_of(~blade)
    stalks, links = [], np.zeros_like(blade)
    for channel, least in zip(cv2.split(lab), LEAST_DIFFERENCES, strict=True):
        difference, noise = _against_near(channel, ground, 2.0 * radius)
        for sign in (1.0, -1.0):
            seen = (sign * difference > max(NOISES * noise, least)) & ~blade & ~cast
            lit = cv2.morphologyEx((seen & ~shadow).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
            # What lies between lit parts is a stalk's brown middle, not shadow.
            between = seen & (cv2.morphologyEx(lit, cv2.MORPH_CLOSE, small_disc) > 0)
            thin = thin_parts(((lit > 0) & ~shadow & ~blade & ~cast) | between, radius)
            stalks += _stalks(thin & ~leaflets, away, size)
            if leaflets.any():
                links |= _links(thin & ~leaflets, blade, leaflets)
    if not stalks:
        for rival in rivals:
            stalks += _single(_stalks(thin_parts(rival & ~blade & ~cast & ~leaflets, radius), away, size))
    if not leaflets.any():
        stalks = _without_threads(stalks, blade, away, size)
    stalks = _besides_own(stalks, blade, away, radius)
    whole = blade | _petiole(stalks, away) | leaflets | links
    return largest_piece(with_fine_ends(lab, largest_piece(whole, seed=blade), cast), seed=blade)


def _without_threads(stalks: list[np.ndarray], blade: np.ndarray, away: np.ndarray, size: float) -> list[np.ndarray]:
    """The stalks without threads and hairs: those are thin, and lie as they fell.

    A petiole goes on as the midrib, about which a blade is alike on both sides; and as it carries the blade it is
    seldom very thin beside it. What is thin and starts where the blade's halves differ far more is no petiole.
    """
    import cv2

    from leafwarp.leaf.shape.base_cues import mirror_symmetry

    spans = [max(float(np.hypot(np.ptp(rows), np.ptp(columns))), 1.0) for rows, columns in map(np.nonzero, stalks)]
    slim = [np.count_nonzero(stalk) < THREAD * size * span for stalk, span in zip(stalks, spans, strict=True)]
    if not any(slim):
        return stalks
    factor = max(1.0, size / MIRRORED)
    small = cv2.resize(blade.astype(np.float32), None, fx=1.0 / factor, fy=1.0 / factor, interpolation=cv2.INTER_AREA)
    contours, _ = cv2.findContours((small > 0.5).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    margin = max(contours, key=len)[:, 0].astype(float)
    margin = margin[:: max(1, len(margin) // MARGIN_POINTS)]
    feet = [np.argwhere(stalk & (away <= RIM + 2.0)).mean(axis=0)[::-1] / factor for stalk in stalks]
    shares = mirror_symmetry(small > 0.5, np.concatenate([margin, feet]) + 0.5)
    least = 1.0 - UNLIKE - MORE_UNLIKE * (1.0 - float(shares.max()))
    return [
        stalk
        for stalk, thin, share in zip(stalks, slim, shares[len(margin) :], strict=True)
        if not thin or share > least
    ]


def _besides_own(stalks: list[np.ndarray], blade: np.ndarray, away: np.ndarray, radius: int) -> list[np.ndarray]:
    """Of the stalks those that go on from the end of the petiole that the blade has already, or are longer than it.

    That petiole is the one long thin line that the blade ends in; where there is none or several, all stalks stay.
    """
    thin = thin_parts(blade, radius)
    core = blade & ~thin
    if not stalks or not core.any():
        return stalks
    size = float(np.sqrt(np.count_nonzero(blade)))
    labels, areas = pieces_of(thin, connectivity=8)
    label_of, from_core = labels[thin], depth_of(~core)
    widths = np.bincount(label_of, depth_of(thin)[thin], minlength=len(areas)) / np.maximum(areas, 1)
    widths = np.maximum(4.0 * widths - 2.0, 1.0)
    reaches = np.zeros(len(areas))
    np.maximum.at(reaches, label_of, from_core[thin])
    plain = reaches > np.maximum(PLAIN_LENGTHS[0] * widths, PLAIN_LENGTHS[1] * size)
    plain &= areas < 1.7 * (reaches + widths) * widths
    if np.count_nonzero(plain) != 1:
        return stalks
    own = int(np.argmax(plain))
    gap = depth_of(~((labels == own) & (from_core > 0.9 * reaches[own])))
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


def _leaflets(lab: np.ndarray, blade: np.ndarray, likely: np.ndarray) -> np.ndarray:
    """Pieces besides the blade that are of its colours."""
    labels, areas = pieces_of(likely & ~blade)
    typical = np.median(lab[blade], axis=0)
    kept = np.zeros(len(areas), bool)
    for label in np.nonzero(areas > 0.002 * np.count_nonzero(blade))[0]:
        colour = np.median(lab[labels == label], axis=0)
        kept[label] = np.linalg.norm((colour - typical) * WEIGHT) < LIKE_BLADE
    return kept[labels]


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
    depth = np.bincount(label_of, depth_of(thin)[thin], minlength=len(areas))
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
