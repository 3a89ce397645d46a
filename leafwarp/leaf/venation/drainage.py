"""The drainage tree of a leaf: shortest paths to the petiole base, and how much of the leaf flows along them.

Every pixel drains one unit down its path of least cost ``1/(0.03 + v)^1.5`` per length, v the vein likelihood, and Q
is the flow accumulated. That is one connected tree whatever the picture's noise, and it stays inside the leaf: a
leaflet drains through its stalk, never across a gap. By Murray's law a vein's radius grows as Q^(1/3), and by
Poiseuille's (conductance as the fourth power of the radius) its conductance as Q^(4/3).
"""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.shape.pixel_graph import pixel_graph
from leafwarp.leaf.venation.branch import Branch

COST_FLOOR, COST_POWER = 0.03, 1.5
LEAST_FLOW = 0.0025  # share of the leaf that a drawn vein drains at least
LEAST_END_FLOW = 0.0002  # the same at the far end of a vein
LEAST_LIKELIHOOD = 0.15  # mean over a stretch of a branch: less is a path through the lamina
STRETCH = 14  # [pixels]


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
    from scipy.sparse.csgraph import dijkstra

    graph = pixel_graph(inside, (COST_FLOOR + likelihood.astype(float)) ** -COST_POWER)
    root = int(graph.nearest(base))
    cost, predecessor = dijkstra(graph.lengths, directed=False, indices=root, return_predecessors=True)
    rows, columns = np.nonzero(inside)
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
        if branches:
            feeds[0] = feeds[min(1, len(feeds) - 1)]  # the first point belongs to the parent
        branches.append(Branch(smooth_open(points[chain], sigma=3.0), feeds))
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


def path_to(pixel: int, predecessor: np.ndarray) -> np.ndarray:
    """Pixels of the way from the base to a pixel."""
    path = [pixel]
    while predecessor[path[-1]] >= 0:
        path.append(int(predecessor[path[-1]]))
    return np.array(path[::-1])


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


def smooth_open(points: np.ndarray, sigma: float) -> np.ndarray:
    """A polyline convolved along its length with a Gaussian, the ends kept."""
    if len(points) < 4:
        return points
    reach = int(min(3 * sigma, len(points) - 1))
    ahead = 2.0 * points[0] - points[reach:0:-1]  # odd reflection keeps the ends in place
    behind = 2.0 * points[-1] - points[-2 : -reach - 2 : -1]
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    longer = np.concatenate([ahead, points, behind])
    return np.column_stack([np.convolve(longer[:, axis], kernel / kernel.sum(), "valid") for axis in (0, 1)])
