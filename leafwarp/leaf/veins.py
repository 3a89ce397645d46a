"""Veins of a photographed leaf: where they are, and how much of the leaf each one feeds.

Likelihood: veins are paler and less green than the lamina, so they are bright ridges of
``Lab a - 100 G/(R+G+B) + L/2``. A directional top-hat and a bank of elongated ridge filters are multiplied
(geometric mean).

Tree: shortest paths from the petiole base with cost ``1/(0.03 + v)^1.5`` per length; every pixel drains one
unit down its path, and Q is the flow accumulated. That is one connected tree whatever the picture's noise. By
Murray's law a vein's radius grows as Q^(1/3) and its conductance as Q^(4/3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leafwarp.leaf.bleed import extend_colours, inner_pixels

DIRECTIONS = 12
COST_FLOOR, COST_POWER = 0.03, 1.5
CONDUCTANCE_POWER = 4.0 / 3.0 * 0.35  # Q^(4/3) spans decades; this share of the exponent reads well as a map
MARGIN = 0.008  # share of the long side along which the margin mixes with the background
THIN = 0.04  # width of a part that is all vein, as a share of the long side
LEAST_FLOW = 0.0025  # share of the leaf that a drawn vein drains at least
LEAST_END_FLOW = 0.0002  # the same at the far end of a vein
LEAST_LIKELIHOOD = 0.15  # mean over a stretch of a branch: less is a path through the lamina
STRETCH = 14  # [pixels]


@dataclass(frozen=True)
class Branch:
    """One unbranched stretch of the vein tree, from where it leaves its parent (or the base) outwards.

    Attributes:
        points: Pixel coordinates (x, y), pixel (0, 0) covering [0, 1] x [0, 1], shape [count, 2].
        flow: Share of the leaf drained through each point, in (0, 1], shape [count].
    """

    points: np.ndarray
    flow: np.ndarray


def vein_likelihood(colour: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """How much each pixel looks like a vein, in [0, 1], shape [height, width], float32; 0 outside the leaf.

    Args:
        colour: 8-bit RGB, shape [height, width, 3]; some 300 to 800 pixels on the long side.
        inside: The leaf's pixels, bool.
    """
    import cv2

    inner = inner_pixels(inside, depth=max(2.0, MARGIN * max(inside.shape)))
    filled = extend_colours(colour, inner).astype(np.float32) / 255.0
    # The extended colours are streaks across the margin, which would pass for veins: blur them.
    filled = np.where(inner[..., None], filled, cv2.GaussianBlur(filled, (0, 0), 5.0))
    lab = cv2.cvtColor(filled, cv2.COLOR_RGB2Lab)
    greenness = 100.0 * filled[..., 1] / (filled.sum(axis=2) + 1e-3)
    channel = cv2.GaussianBlur(lab[..., 1] - greenness + 0.5 * lab[..., 0], (0, 0), 0.8)
    hat, ridge = _directional_top_hat(channel), _ridge_bank(channel)
    hat, ridge = (_by_quantile(response, inside) for response in (hat, ridge))
    likelihood = np.maximum(np.sqrt(hat * ridge), _stalk_middle(inside))
    return np.where(inside, likelihood, 0.0).astype(np.float32)


def _stalk_middle(inside: np.ndarray) -> np.ndarray:
    """1 along the middle of parts too thin to show a vein (the petiole), falling to 0 at their margin; 0 elsewhere."""
    import cv2

    margin = cv2.distanceTransform(np.pad(inside, 1).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1]
    reach = 2 * int(np.ceil(THIN * max(inside.shape))) + 1
    deepest = cv2.dilate(margin, np.ones((reach, reach), np.uint8))
    thin = deepest < 0.5 * THIN * max(inside.shape)
    return np.where(thin, (margin / np.maximum(deepest, 1.0)) ** 2, 0.0)


def _by_quantile(response: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Scaled so that the strongest 3 % reach 1; a flat picture stays at 0."""
    top = max(float(np.quantile(response[inside], 0.97)), 0.5)
    return np.clip(response / top, 0.0, 1.0)


def _directional_top_hat(channel: np.ndarray) -> np.ndarray:
    """Best directional opening less the worst: what a line fits into along one direction only."""
    import cv2

    length = max(7, round(0.028 * max(channel.shape)) | 1)
    best = np.full_like(channel, -np.inf)
    worst = np.full_like(channel, np.inf)
    for angle in np.arange(DIRECTIONS) * (np.pi / DIRECTIONS):
        kernel = np.zeros((length, length), np.uint8)
        middle, reach = length // 2, (length // 2) * np.array([np.cos(angle), np.sin(angle)])
        ends = [tuple(np.rint(middle + sign * reach).astype(int).tolist()) for sign in (-1, 1)]
        cv2.line(kernel, *ends, 1)
        opened = cv2.morphologyEx(channel, cv2.MORPH_OPEN, kernel)
        np.maximum(best, opened, out=best)
        np.minimum(worst, opened, out=worst)
    return best - worst


def _ridge_bank(channel: np.ndarray) -> np.ndarray:
    """Largest response of second-derivative Gaussians, long along the ridge, over directions and two widths."""
    import cv2

    best = np.zeros_like(channel)
    unit = max(channel.shape) / 512.0
    for across in (1.2 * unit, 2.4 * unit):
        along = 3.0 * across
        half = int(np.ceil(2.5 * along))
        y, x = np.mgrid[-half : half + 1, -half : half + 1].astype(float)
        for angle in np.arange(DIRECTIONS) * (np.pi / DIRECTIONS):
            u, v = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
            kernel = (1.0 - (v / across) ** 2) * np.exp(-0.5 * ((u / along) ** 2 + (v / across) ** 2))
            kernel -= kernel.mean()
            kernel /= np.abs(kernel).sum()
            np.maximum(best, cv2.filter2D(channel, -1, kernel.astype(np.float32)), out=best)
    return best


def drainage(likelihood: np.ndarray, inside: np.ndarray, base: np.ndarray) -> tuple[np.ndarray, ...]:
    """Shortest-path tree of a leaf.

    Args:
        likelihood: Vein likelihood in [0, 1], shape [height, width].
        inside: The leaf's pixels; those not connected to the base are left out.
        base: Pixel coordinates (x, y) of the petiole's end.

    Returns:
        Rows and columns of the pixels, shape [count] each; the cost to each from the base (infinite where not
        connected); and the predecessor of each on its path (-1 for the base and what is not connected).
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import dijkstra

    rows, columns = np.nonzero(inside)
    number = np.full(np.add(inside.shape, 2), -1, np.int32)
    number[rows + 1, columns + 1] = np.arange(len(rows))
    price = (COST_FLOOR + likelihood[rows, columns].astype(float)) ** -COST_POWER
    starts, ends, costs = [], [], []
    for step_y, step_x in ((0, 1), (1, 0), (1, 1), (1, -1)):
        neighbour = number[rows + 1 + step_y, columns + 1 + step_x]
        here = np.nonzero(neighbour >= 0)[0]
        there = neighbour[here]
        starts.append(here)
        ends.append(there)
        costs.append(0.5 * np.hypot(step_y, step_x) * (price[here] + price[there]))
    graph = csr_matrix(
        (np.concatenate(costs), (np.concatenate(starts), np.concatenate(ends))), shape=(len(rows), len(rows))
    )
    root = int(np.argmin(np.hypot(columns + 0.5 - base[0], rows + 0.5 - base[1])))
    cost, predecessor = dijkstra(graph, directed=False, indices=root, return_predecessors=True)
    return rows, columns, cost, np.where(predecessor < 0, -1, predecessor)


def vein_tree(likelihood: np.ndarray, inside: np.ndarray, base: np.ndarray) -> list[Branch]:
    """The leaf's veins as smooth branches, the midrib first; arguments as for :func:`drainage`."""
    rows, columns, cost, predecessor = drainage(likelihood, inside, base)
    flow = accumulate(cost, predecessor)
    seen = likelihood[rows, columns]
    points = np.column_stack([columns + 0.5, rows + 0.5])
    branches = []
    for chain in _chains(flow, predecessor):
        kept = _visible_length(seen[chain])
        if branches and kept < 4:
            continue
        chain = chain[:kept] if branches else chain
        feeds = flow[chain]
        feeds[0] = feeds[min(1, len(feeds) - 1)]  # the first point belongs to the parent
        branches.append(Branch(_smooth_open(points[chain], sigma=3.0), feeds))
    return branches


def accumulate(cost: np.ndarray, predecessor: np.ndarray) -> np.ndarray:
    """Share of all pixels that drain through each one, shape [count]; pixels farther than their predecessor."""
    flow = np.isfinite(cost).astype(float).tolist()
    parents = predecessor.tolist()
    for pixel in np.argsort(-np.where(np.isfinite(cost), cost, -1.0), kind="stable").tolist():
        parent = parents[pixel]
        if parent >= 0:
            flow[parent] += flow[pixel]
    flow = np.array(flow)
    return flow / max(flow.max(), 1.0)


def _chains(flow: np.ndarray, predecessor: np.ndarray) -> list[np.ndarray]:
    """The tree of pixels cut into chains that follow the largest child, largest first."""
    kept = np.nonzero(flow >= LEAST_END_FLOW)[0]
    kept = kept[np.argsort(-flow[kept], kind="stable")]
    heir: dict[int, int] = {}
    heads = []
    for pixel in kept.tolist():  # by falling flow: the first child seen is the largest
        parent = int(predecessor[pixel])
        if parent >= 0 and parent not in heir:
            heir[parent] = pixel
        elif flow[pixel] >= LEAST_FLOW:
            heads.append(pixel)
    chains = []
    for head in heads:
        parent = int(predecessor[head])
        chain = [head] if parent < 0 else [parent, head]
        while chain[-1] in heir:
            chain.append(heir[chain[-1]])
        chains.append(np.array(chain))
    return chains


def _visible_length(likelihood: np.ndarray) -> int:
    """How far along a branch it looks like a vein: up to the first stretch that does not."""
    total = np.concatenate([[0.0], np.cumsum(likelihood)])
    stretch = min(STRETCH, len(likelihood))
    faint = np.nonzero((total[stretch:] - total[:-stretch]) / stretch < LEAST_LIKELIHOOD)[0]
    return int(faint[0]) if len(faint) else len(likelihood)


def _smooth_open(points: np.ndarray, sigma: float) -> np.ndarray:
    """A polyline convolved along its length with a Gaussian, the ends kept."""
    if len(points) < 4:
        return points
    reach = int(min(3 * sigma, len(points) - 1))
    ahead = 2.0 * points[0] - points[reach:0:-1]  # odd reflection keeps the ends in place
    behind = 2.0 * points[-1] - points[-2 : -reach - 2 : -1]
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    longer = np.concatenate([ahead, points, behind])
    return np.column_stack([np.convolve(longer[:, axis], kernel / kernel.sum(), "valid") for axis in (0, 1)])
