"""Veins for a leaf whose picture shows none: main veins by the outline, the others by space colonisation.

Auxin sources are scattered over the lamina. Each draws the nearest vein node that it can see towards itself; a node
grows one step along the mean direction of the sources that draw it; a source that a vein comes close to is used up
(A. Runions et al. 2005, "Modeling and visualization of leaf venation patterns", open venation). Side veins start at
even distances along the main ones, on both sides, and lean forward as the tangent of the vein is mixed in.
"""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.venation.likelihood import stalk_middle
from leafwarp.leaf.venation.shape import STALK_DEPTH, LeafShape, main_veins

SOURCES = 900  # auxin sources at the start
SPACING = 0.075  # between side veins along a main vein, as a share of the long side
KILL = 0.022  # distance at which a vein uses up a source, as a share of the long side
STEP = 0.008  # growth of a node, as a share of the long side
LEAN = 0.65  # weight of the main vein's direction beside that of the sources
INERTIA = 0.8  # weight of a side vein's own direction
SIDE_VEIN = 0.7  # likelihood of a side vein
SIGHT = 9  # samples along the line from a node to a source
ROUNDS = 160


def made_up_likelihood(shape: LeafShape, kind: str, seed: int = 0) -> np.ndarray:
    """Likelihood of a vein in [0, 1], shape [height, width], 1 on main veins, 0 outside the leaf.

    Args:
        shape: The leaf.
        kind: "pinnate" or "palmate".
        seed: Of the places of the auxin sources.
    """
    import cv2

    mains = main_veins(shape, kind)
    drawn = np.zeros(shape.inside.shape, np.uint8)
    for parents, children in _grow(shape, mains, np.random.default_rng(seed)):
        ends = np.rint(np.stack([parents, children], axis=1) * 16 - 8).astype(np.int32)
        cv2.polylines(drawn, list(ends), False, round(255 * SIDE_VEIN), 1, cv2.LINE_AA, 4)
    for line in mains:
        cv2.polylines(drawn, [np.rint(line * 16 - 8).astype(np.int32)], False, 255, 2, cv2.LINE_AA, 4)
    return np.where(shape.inside, np.maximum(drawn / 255.0, stalk_middle(shape.inside)), 0.0)


def _grow(shape: LeafShape, mains: list[np.ndarray], random: np.random.Generator) -> list[tuple[np.ndarray, ...]]:
    """Steps of growth: places of the nodes that grew and of the nodes they grew, shape [count, 2] each."""
    from scipy.spatial import cKDTree

    long_side = max(shape.inside.shape)
    step, kill = STEP * long_side, KILL * long_side
    sources = _scatter(shape, mains, random, 0.6 * kill)
    nodes, tangents, sides = _side_buds(shape, mains)
    axes, closed = tangents, np.zeros(len(nodes), bool)
    grown = []
    for _ in range(ROUNDS):
        if not len(sources) or not len(nodes):
            break
        # A bud grows to its own side only; the nearest few nodes are tried in turn.
        count = min(6, len(nodes))
        distance, near = cKDTree(nodes).query(sources, k=np.arange(1, count + 1))
        apart = sources[:, None] - nodes[near]
        turn = tangents[near][..., 0] * apart[..., 1] - tangents[near][..., 1] * apart[..., 0]
        allowed = (sides[near] * turn >= 0.0) & ~closed[near]
        choice = np.argmax(allowed, axis=1)
        pick = np.arange(len(sources))
        usable = allowed.any(axis=1)
        usable[usable] &= _visible(shape, nodes[near[pick, choice]][usable], sources[usable])
        drawn = near[pick, choice][usable]
        if not len(drawn):
            break
        pull = np.zeros_like(nodes)
        unit = apart[pick, choice][usable] / np.maximum(distance[pick, choice][usable], 1e-9)[:, None]
        np.add.at(pull, drawn, unit)
        active = np.unique(drawn)
        heading = pull[active] / np.maximum(np.linalg.norm(pull[active], axis=1), 1e-9)[:, None]
        heading += LEAN * axes[active] + INERTIA * tangents[active]
        heading /= np.maximum(np.linalg.norm(heading, axis=1), 1e-9)[:, None]
        new = nodes[active] + step * heading
        fits = shape.holds(new) & (cKDTree(nodes).query(new)[0] > 0.4 * step)
        if not fits.any():
            break
        grown.append((nodes[active][fits], new[fits]))
        closed[active[fits]] = sides[active[fits]] != 0.0  # a bud opens once; nodes may branch
        closed = np.concatenate([closed, np.zeros(np.count_nonzero(fits), bool)])
        nodes = np.concatenate([nodes, new[fits]])
        tangents = np.concatenate([tangents, heading[fits]])
        axes = np.concatenate([axes, axes[active][fits]])
        sides = np.concatenate([sides, np.zeros(np.count_nonzero(fits))])
        sources = sources[cKDTree(new[fits]).query(sources)[0] > kill]
    return grown


def _scatter(shape: LeafShape, mains: list[np.ndarray], random: np.random.Generator, clear: float) -> np.ndarray:
    """Auxin sources on the lamina, away from the main veins and the stalk, shape [count, 2]."""
    from scipy.spatial import cKDTree

    rows, columns = np.nonzero(shape.inside & (shape.depth > 0.25 * STALK_DEPTH * max(shape.inside.shape)))
    if not len(rows):
        return np.zeros((0, 2))
    picked = random.choice(len(rows), size=min(SOURCES, len(rows)), replace=False)
    places = np.column_stack([columns[picked], rows[picked]]) + random.random((len(picked), 2))
    return places[cKDTree(np.concatenate(mains)).query(places)[0] > clear]


def _side_buds(shape: LeafShape, mains: list[np.ndarray]) -> tuple[np.ndarray, ...]:
    """Where side veins may start: places, tangents of the main vein there, and sides (-1, 1); alternating."""
    places, tangents, sides = [], [], []
    spacing = SPACING * max(shape.inside.shape)
    for line in mains:
        arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        for side, shift in ((-1.0, 0.35), (1.0, 0.85)):
            at = np.arange(shift * spacing, arc[-1], spacing)
            spots = np.column_stack([np.interp(at, arc, line[:, axis]) for axis in (0, 1)])
            ahead = np.column_stack([np.interp(at + 0.5 * spacing, arc, line[:, axis]) for axis in (0, 1)])
            behind = np.column_stack([np.interp(at - 0.5 * spacing, arc, line[:, axis]) for axis in (0, 1)])
            along = ahead - behind
            column, row = np.clip(spots.astype(int), 0, np.array(shape.inside.shape[::-1]) - 1).T
            lamina = shape.depth[row, column] > STALK_DEPTH * max(shape.inside.shape)
            places.append(spots[lamina])
            tangents.append((along / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None])[lamina])
            sides.append(np.full(np.count_nonzero(lamina), side))
    return np.concatenate(places), np.concatenate(tangents), np.concatenate(sides)


def _visible(shape: LeafShape, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Whether the straight line from start to end stays inside the leaf."""
    seen = np.ones(len(starts), bool)
    for share in np.linspace(0.0, 1.0, SIGHT + 2)[1:-1]:
        seen &= shape.holds(starts + share * (ends - starts))
    return seen
