"""Signs by which a leaf's petiole is told from its tip and its sides, for candidates on its margin.

Veins: each pixel's line direction is kept as a doubled angle, ``z = |z| exp(2 i theta)`` (theta and theta + pi are one
direction), averaged from the squared colour gradients, so that pale veins and dark creases are alike. Turned into the
axis that leads from a candidate to the leaf's middle and mirrored on its one side, the mean of z has an imaginary part
above 0 where lines lead outwards *away* from the candidate, as side veins leave a midrib at acute angles. The second
sign is how well the lines radiate from the candidate, as the main veins of a lobed leaf do.

Shape: the two halves beside the midrib are alike, the teeth point to the tip (they rise slowly and fall suddenly on the
way there), and most blades are broader at the base than at the tip; one whose veins are parallel always is, or cut.
"""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.bleed import extend_colours, inner_pixels
from leafwarp.leaf.shape.curve import resample_closed, smooth_closed

POINTS = 5000  # of the leaf that stand for it
MARGIN = 0.012  # share of the long side along which the margin mixes with the background
FINE_BLUR, COARSE_BLUR = 0.005, 0.016  # of the gradients and of the directions, as shares of the long side
GRAIN = 0.003  # squared Lab difference a pixel below which a gradient is noise
VISIBLE = 0.8  # mean magnitude of the lines where veins show; faint ones count by as much less
TOOTH_POINTS, TOOTH_FINE, TOOTH_COARSE = 720, 1.0, 12.0  # points along the margin; blurs that bound a tooth
SMOOTH_SLOPE, CORNER = 0.15, 36  # slope of a margin without teeth; points about a corner of the blade
PARALLEL_FROM, PARALLEL_FULL = 0.5, 0.8  # mean alignment with the axis from which veins are taken for parallel
PARALLEL_SLANT = 0.25  # side veins that slant more than this make a leaf pinnate, however straight
SLICES, END = 25, 0.3  # slices across the leaf; share of its length that is its end


def line_directions(colours: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Doubled-angle direction of the lines at each pixel, shape [height, width], complex.

    Args:
        colours: 8-bit RGB, shape [height, width, 3].
        inside: The leaf's pixels, shape [height, width], bool.

    Returns:
        Magnitude up to about 1 where one direction rules, 0 off the leaf and in plain areas.
    """
    import cv2

    side = max(inside.shape)
    inner = inner_pixels(inside, depth=max(2.0, MARGIN * side))
    filled = extend_colours(colours, inner).astype(np.float32) / 255.0
    lab = cv2.cvtColor(filled, cv2.COLOR_RGB2Lab)
    real = np.zeros(inside.shape, np.float32)
    imaginary = np.zeros_like(real)
    for channel in range(3):
        smooth = cv2.GaussianBlur(lab[..., channel], (0, 0), FINE_BLUR * side)
        right = np.where(inner, cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=0.125), 0.0)
        down = np.where(inner, cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=0.125), 0.0)
        power = cv2.GaussianBlur(right**2 + down**2, (0, 0), 4.0 * COARSE_BLUR * side)
        weight = 1.0 / (power + GRAIN)
        # A line runs across its gradient: the doubled angle turns by pi.
        real -= weight * (right**2 - down**2)
        imaginary -= weight * 2.0 * right * down
    blur = (cv2.GaussianBlur(part, (0, 0), COARSE_BLUR * side) for part in (real, imaginary))
    return np.where(inner, next(blur) + 1j * next(blur), 0.0)


def vein_signs(directions: np.ndarray, candidates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean line direction about each candidate's axis, and how far lines radiate from it.

    Args:
        directions: Of :func:`line_directions`.
        candidates: Window points (x, y), shape [count, 2].

    Returns:
        Mirrored mean, shape [count], complex: its imaginary part is the slant away from the candidate, its real part
        the alignment with the axis. Radiation in [-1, 1], shape [count].
    """
    rows, columns = np.nonzero(directions)
    if not len(rows):
        return np.zeros(len(candidates), complex), np.zeros(len(candidates))
    thinned = np.s_[:: max(1, len(rows) // POINTS)]
    points = np.column_stack([columns, rows])[thinned] + 0.5
    lines = directions[rows, columns][thinned].astype(complex)
    total = max(float(np.abs(lines).sum()), VISIBLE * len(lines), 1e-9)
    middle = points.mean(axis=0)
    whole = lines.sum()
    x, y = np.ascontiguousarray(points.T)
    cosines, sines = lines.real.copy(), lines.imag.copy()
    means = np.zeros(len(candidates), complex)
    radiation = np.zeros(len(candidates))
    for index, candidate in enumerate(candidates):
        along, across = middle - candidate
        right, down = x - candidate[0], y - candidate[1]
        turn = np.exp(-2j * np.arctan2(across, along))
        one_side = turn * lines[along * down > across * right].sum()
        means[index] = (one_side + (turn * whole - one_side).conj()) / total
        # The doubled angle's cosine and sine by its tangent's parts; nothing radiates from the candidate's own pixel.
        squares = right * right, down * down
        radial = cosines * (squares[0] - squares[1]) + sines * (2.0 * right * down)
        radiation[index] = (radial / np.maximum(squares[0] + squares[1], 1e-9)).sum() / total
    return means, radiation


def parallel_share(mean: np.ndarray) -> np.ndarray:
    """How surely the veins are parallel to the axis, in [0, 1], from the mirrored means."""
    aligned = np.clip((mean.real - PARALLEL_FROM) / (PARALLEL_FULL - PARALLEL_FROM), 0.0, 1.0)
    return aligned * np.clip(2.0 - np.abs(mean.imag) / (0.5 * PARALLEL_SLANT), 0.0, 1.0)


def end_breadth(inside: np.ndarray, candidates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The leaf's ends as seen from each candidate.

    Returns:
        Breadth of the end at each candidate less that of the opposite end, over the greatest breadth, shape [count];
        the leaf's length from there over its greatest breadth, shape [count].
    """
    rows, columns = np.nonzero(inside)
    points = (np.column_stack([columns, rows]) + 0.5)[:: max(1, len(rows) // POINTS)]
    middle = points.mean(axis=0)
    area = len(rows) / len(points)  # that each of the points stands for
    breadths, slenderness = np.zeros(len(candidates)), np.zeros(len(candidates))
    for index, candidate in enumerate(candidates):
        axis = (middle - candidate) / max(float(np.linalg.norm(middle - candidate)), 1e-9)
        along = points @ axis
        along -= along.min()
        length = float(along.max())
        slices = (along * (SLICES / max(length, 1e-9))).astype(np.intp)
        counts = np.bincount(np.minimum(slices, SLICES - 1), minlength=SLICES)
        ends = max(1, round(END * SLICES))
        breadths[index] = (counts[:ends].mean() - counts[-ends:].mean()) / counts.max()
        slenderness[index] = length**2 / (SLICES * area * counts.max())
    return breadths, slenderness


def mirror_symmetry(inside: np.ndarray, candidates: np.ndarray) -> np.ndarray:
    """Share of the leaf that its mirror image covers, about the axis from each candidate to the leaf's middle."""
    rows, columns = np.nonzero(inside)
    points = (np.column_stack([columns, rows]) + 0.5)[:: max(1, len(rows) // POINTS)]
    middle = points.mean(axis=0)
    padded = np.pad(inside, 1)
    height, width = padded.shape
    offset = points - middle
    right, down = np.ascontiguousarray(offset.T)
    shares = np.zeros(len(candidates))
    for index, candidate in enumerate(candidates):
        axis = (middle - candidate) / max(float(np.linalg.norm(middle - candidate)), 1e-9)
        twice = 2.0 * (offset @ axis)
        # One past the middle of the padding's pixel, so that cutting a positive number off rounds it down.
        column = np.clip(middle[0] + twice * axis[0] - right + 1.0, 0.0, width - 1.0).astype(np.intp)
        row = np.clip(middle[1] + twice * axis[1] - down + 1.0, 0.0, height - 1.0).astype(np.intp)
        shares[index] = np.count_nonzero(padded.take(row * width + column)) / len(points)
    return shares


def tooth_lean(polygon: np.ndarray, candidates: np.ndarray) -> np.ndarray:
    """How far the margin's teeth lean away from each candidate, in about [-1, 1], 0 for a smooth margin.

    It is the skewness of the margin's slope against its own smooth course, on both ways from the candidate to the point
    farthest from it.
    """
    points = resample_closed(polygon, TOOTH_POINTS)
    coarse = smooth_closed(points, TOOTH_COARSE)
    tangent = np.roll(coarse, -1, axis=0) - np.roll(coarse, 1, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1), 1e-9)[:, None]
    x, y = points.T
    turn = np.sign(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    outwards = turn * np.column_stack([tangent[:, 1], -tangent[:, 0]])
    height = ((smooth_closed(points, TOOTH_FINE) - coarse) * outwards).sum(axis=1)
    step = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).mean()
    slope = np.clip((np.roll(height, -1) - np.roll(height, 1)) / (2.0 * step), -1.0, 1.0)
    spread = (np.mean(slope**2) + SMOOTH_SLOPE**2) ** 1.5
    cubes = np.tile(slope**3, 2)
    leans = np.zeros(len(candidates))
    for index, candidate in enumerate(candidates):
        start = int(np.argmin((x - candidate[0]) ** 2 + (y - candidate[1]) ** 2))
        end = int(np.argmax((x - x[start]) ** 2 + (y - y[start]) ** 2))
        forth = (end - start) % TOOTH_POINTS
        # The corners at the base and at the tip are no teeth.
        ahead = cubes[start + CORNER : start + max(CORNER, forth - CORNER)]
        back = cubes[end + CORNER : end + max(CORNER, TOOTH_POINTS - forth - CORNER)]
        leans[index] = (np.sum(back) - np.sum(ahead)) / (TOOTH_POINTS * spread)
    return leans
