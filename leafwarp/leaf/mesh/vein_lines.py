"""Veins as lines that triangles can follow: the main ones, well apart, cut into pieces as long as an edge.

Veins found in a photo cross, run beside one another and touch the margin; triangles of one size cannot follow
that. The veins are taken from the thickest to the thinnest. Of each the part is kept that stays clear of the
margin and of what was kept before, from its fork outwards. A fork moves to a point of the parent that is a whole
number of pieces from the next one, and is left out where it would open by less than 30 degrees.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from leafwarp.leaf.mesh.segments import conflicts
from leafwarp.leaf.venation.veins import Branch

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

LEAST_FLOW = 0.01  # share of the leaf that a main vein drains
THICK_FLOW = 0.05  # of a vein that is kept though it could not be joined to its parent
LEAST_END_SHARE = 0.25  # of that, at the far end of a vein
# Lengths in mean edges of the mesh.
FINE = 0.1  # step at which veins are compared
SMOOTHING = 0.5  # a vein wiggles less than an edge can show
CLEARANCE = 0.9  # from the margin
SPACING = 3.5  # between two lines, away from their fork: triangles between nearer ones lie in rows
OPENING = np.radians(30.0)  # least angle at a fork
TYPICAL_OPENING = np.radians(50.0)
LEAST_LENGTH = 4.0  # of a line
REACH = 0.65  # how far from its parent a vein may start
LINK = 4.0  # and how far, where its parent is too near to the margin to be a line there
LINK_CLEARANCE = 0.6  # from the margin, on that way
SNAP = 0.85  # two forks nearer than this are one
LONGEST_PIECE = 1.45
LOOP = 1.5  # a vein that comes so near to itself again ends there
LEAST_DISTANCE, LEAST_OPENING = 0.45, np.radians(25.0)  # of two straight pieces, apart and from a shared end
BASE_REACH = 1.5  # a line that starts so near to the petiole's end starts at it


@dataclass(frozen=True)
class VeinLines:
    """Lines for the mesh to follow, the thickest first.

    Attributes:
        points: Ends of the pieces [m], shape [count, 2]; a fork is one point.
        pieces: The two points of each piece, shape [piece_count, 2].
        flow: Share of the leaf that each piece drains, the mean of its ends, shape [piece_count].
        line: Which line each piece belongs to, shape [piece_count].
        at_base: The point that is the petiole's end, -1 where no line starts there.
    """

    points: np.ndarray
    pieces: np.ndarray
    flow: np.ndarray
    line: np.ndarray
    at_base: int = -1

    @property
    def count(self) -> int:
        """Number of lines."""
        return int(self.line.max()) + 1 if len(self.line) else 0

    @property
    def lengths(self) -> np.ndarray:
        """Length of each piece [m], shape [piece_count]."""
        return np.linalg.norm(np.subtract(*self.points[self.pieces.T]), axis=1)


NO_LINES = VeinLines(np.zeros((0, 2)), np.zeros((0, 2), np.int64), np.zeros(0), np.zeros(0, np.int64))


def _pieces(length: float) -> int:
    """Number of pieces that a stretch of a line is cut into."""
    return max(1, round(length), int(np.ceil(length / LONGEST_PIECE)))


@dataclass
class _Line:
    """A kept vein: its points at even fine steps, where along it others fork off, and where it forks off itself."""

    points: np.ndarray
    flow: np.ndarray
    parent: int = -1
    parent_arc: float = 0.0
    forks: list[float] = field(default_factory=list)
    starts_at_base: bool = False

    def __post_init__(self) -> None:
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        self.arc = np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length(self) -> float:
        return float(self.arc[-1])

    def at(self, arc: float) -> np.ndarray:
        return np.array([np.interp(arc, self.arc, self.points[:, axis]) for axis in (0, 1)])

    def nodes(self) -> np.ndarray:
        """Distances along the line of its pieces' ends: the forks, and even steps between them."""
        stops = np.unique([0.0, *self.forks, self.length])
        gaps = [np.linspace(first, last, _pieces(last - first), endpoint=False) for first, last in pairwise(stops)]
        return np.append(np.concatenate(gaps), self.length)


def clean_veins(
    veins: Sequence[Branch], boundary: Sequence[np.ndarray], edge: float, most: int | None = None
) -> VeinLines:
    """The main veins as lines that triangles of a size can follow.

    Args:
        veins: Veins with their points [m], from where they leave their parent (or the petiole) outwards.
        boundary: Closed polygons of the mesh's boundary [m], the outline first, its first point the petiole's end.
        edge: Mean edge length of the mesh [m].
        most: Number of lines kept at most, the thickest; all where it is not given.
    """
    from scipy.spatial import cKDTree

    loops = [loop / edge for loop in boundary]
    margin = cKDTree(np.concatenate([_even(np.concatenate([loop, loop[:1]])) for loop in loops]))
    lines: list[_Line] = []
    seen: list[np.ndarray] = []  # every vein so far, kept or not
    for vein in sorted(veins, key=lambda vein: -float(vein.flow[0])):
        if most is not None and len(lines) == most:
            break
        if len(vein.points) < 2 or vein.flow[0] < LEAST_FLOW:
            continue
        points, flow = _fine(vein, edge)
        thin = np.flatnonzero(flow < LEAST_END_SHARE * LEAST_FLOW)
        end = int(thin[0]) if len(thin) else len(flow)
        if end < 2:
            continue
        end = min(end, _unlooped(points))
        points, flow = points[:end], flow[:end]
        line = _kept_part(points, flow, lambda given, least: _clear(given, least, margin, loops), lines, loops[0], seen)
        seen.append(points)
        if line is not None:
            lines.append(line)
    while True:
        made = _cut(lines)
        pairs = conflicts(made.points, made.pieces, LEAST_DISTANCE, LEAST_OPENING)
        if len(pairs) == 0:
            return replace(made, points=made.points * edge)
        # Straight pieces may do what the curves did not: the thinner line is left out, with what forks off it.
        lines = _without(lines, int(made.line[pairs].max()))


def _fine(vein: Branch, edge: float) -> tuple[np.ndarray, np.ndarray]:
    """Points of a vein at fine even steps [edges], smoothed, and the flow through them."""
    from scipy.ndimage import gaussian_filter1d

    rough = np.asarray(vein.points, np.float64) / edge
    points = _even(rough)
    flow = np.interp(np.linspace(0.0, 1.0, len(points)), _shares(rough), vein.flow)
    if len(points) < 4:
        return points, flow
    ramp = np.linspace(0.0, 1.0, len(points))[:, None]
    chord = (1.0 - ramp) * points[0] + ramp * points[-1]  # the ends stay: what is smoothed is 0 there
    width = min(SMOOTHING / FINE, 0.2 * len(points))
    # Odd reflection: the offsets from the chord change sign past an end.
    offset = points - chord
    odd = np.concatenate([-offset[:0:-1], offset, -offset[-2::-1]])
    smooth = gaussian_filter1d(odd, width, axis=0)[len(points) - 1 : 2 * len(points) - 1]
    return chord + smooth, flow


def _unlooped(points: np.ndarray) -> int:
    """How many of a line's points there are before it comes back to itself."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(LOOP, output_type="ndarray")
    back = pairs[np.abs(pairs[:, 1] - pairs[:, 0]) * FINE > 2.0 * LOOP]
    return int(back.max(axis=1).min()) if len(back) else len(points)


def _even(points: np.ndarray) -> np.ndarray:
    """Points of a polyline at even steps of about FINE."""
    shares = _shares(points)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    at = np.linspace(0.0, 1.0, max(2, int(np.ceil(length / FINE)) + 1))
    return np.column_stack([np.interp(at, shares, points[:, axis]) for axis in (0, 1)])


def _shares(points: np.ndarray) -> np.ndarray:
    """Distance along a polyline to each of its points, the whole being 1."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return arc / max(arc[-1], 1e-300)


def _kept_part(
    points: np.ndarray,
    flow: np.ndarray,
    clear_of: Callable[[np.ndarray, float], np.ndarray],
    lines: list[_Line],
    outline: np.ndarray,
    seen: list[np.ndarray],
) -> _Line | None:
    """What the mesh can follow of a vein, given the lines before it; None where that is too short."""
    clear = clear_of(points, CLEARANCE)
    distance = _distance(points, [line.points for line in lines])
    free = clear & (distance >= SPACING)
    if distance[0] > REACH and not (seen and _distance(points[:1], seen)[0] <= REACH):
        return _free_line(points, flow, free, outline)
    # Where it leaves its parent, or where it is first clear, as after a narrow petiole.
    apart = np.flatnonzero((distance > REACH) & clear)
    if len(apart) and distance[apart[0]] <= LINK:
        first = int(apart[0])
        line = _forked_line(points[first:], flow[first:], clear[first:], distance[first:], lines)
        if line is not None and clear_of(line.points[: round(LINK / FINE)], LINK_CLEARANCE).all():
            stem = lines[line.parent]
            if 0.0 < line.parent_arc < stem.length and line.parent_arc not in stem.forks:
                stem.forks.append(line.parent_arc)
            return line
    return _free_line(points, flow, free, outline) if flow[0] >= THICK_FLOW else None


def _free_line(points: np.ndarray, flow: np.ndarray, good: np.ndarray, outline: np.ndarray) -> _Line | None:
    """A line without a parent: the longest part that is clear of margin and other lines, begun at the petiole's
    end where it comes near to it."""
    first, last = _longest_run(good)
    if (last - first) * FINE < LEAST_LENGTH:
        return None
    part, feeds = points[first:last], flow[first:last]
    direction = part[min(len(part) - 1, round(1.0 / FINE))] - outline[0]
    sides = [outline[1] - outline[0], outline[-1] - outline[0]]
    if np.hypot(*(part[0] - outline[0])) > BASE_REACH or not all(_opens(direction, side) for side in sides):
        return _Line(part, feeds)
    beyond = np.linalg.norm(part - outline[0], axis=1) > 1.0
    start = int(np.argmax(beyond))
    joined = _even(np.concatenate([outline[:1], part[start:]]))
    return _Line(
        joined, np.interp(np.linspace(0, 1, len(joined)), np.linspace(0, 1, len(feeds)), feeds), starts_at_base=True
    )


def _forked_line(
    points: np.ndarray, flow: np.ndarray, clear: np.ndarray, distance: np.ndarray, lines: list[_Line]
) -> _Line | None:
    """A line that forks off a kept one, up to where it comes too near to a line or to the margin; ``distance`` from
    the lines."""
    parent = int(np.argmin([_distance(points[:1], [line.points])[0] for line in lines]))
    stem = lines[parent]
    place = float(stem.arc[np.argmin(np.linalg.norm(stem.points - points[0], axis=1))])
    # The fork lies behind the nearest point: the vein has been leaving its parent for a while.
    place = max(0.0, place - distance[0] / np.tan(TYPICAL_OPENING))
    known = np.array([0.0, stem.length, *stem.forks])
    if np.abs(known - place).min() < SNAP:
        place = float(known[np.argmin(np.abs(known - place))])
    fork = stem.at(place)
    run = np.arange(1, len(points) + 1) * FINE + np.hypot(*(points[0] - fork))
    needed = np.minimum(SPACING, np.maximum(0.8 * REACH, np.sin(OPENING) * (run - REACH)))
    good = clear & (distance >= needed)
    last = len(good) if good.all() else int(np.argmin(good))
    if last * FINE + 1.0 < LEAST_LENGTH:
        return None
    beyond = int(np.argmax(np.linalg.norm(points[:last] - fork, axis=1) > 0.8))
    joined = _even(np.concatenate([fork[None], points[beyond:last]]))
    direction = joined[min(len(joined) - 1, round(1.0 / FINE))] - fork
    if not all(_opens(direction, other) for other in _directions(lines, parent, place)):
        return None
    feeds = np.interp(np.linspace(0.0, 1.0, len(joined)), np.linspace(0.0, 1.0, last), flow[:last])
    return _Line(joined, feeds, parent, place)


def _directions(lines: list[_Line], parent: int, place: float) -> list[np.ndarray]:
    """Where the lines at a fork lead, one edge away from it."""
    stem = lines[parent]
    fork = stem.at(place)
    ways = [stem.at(place + step) - fork for step in (-1.0, 1.0) if 0.0 < place + step < stem.length]
    if stem.parent >= 0 and place == 0.0:
        ways += _directions(lines, stem.parent, stem.parent_arc)
    ways += [line.at(1.0) - fork for line in lines if line.parent == parent and line.parent_arc == place]
    return ways


def _opens(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two directions are far enough apart for triangles between them."""
    return bool(abs(np.arctan2(one[0] * other[1] - one[1] * other[0], one @ other)) >= OPENING)


def _distance(points: np.ndarray, lines: list[np.ndarray]) -> np.ndarray:
    """Distance of each point from the nearest of some lines; infinite where there is none."""
    from scipy.spatial import cKDTree

    if not lines:
        return np.full(len(points), np.inf)
    return cKDTree(np.concatenate(lines)).query(points)[0]


def _clear(points: np.ndarray, least: float, margin: cKDTree, loops: list[np.ndarray]) -> np.ndarray:
    """Which points of a line are inside the leaf and at least so far from its margin."""
    clear = margin.query(points)[0] >= least
    # A stretch that stays clear of the margin is inside as a whole or not at all.
    for first, last in _runs(clear):
        clear[first:last] = sum(_encloses(loop, points[first]) for loop in loops) % 2 == 1
    return clear


def _encloses(polygon: np.ndarray, point: np.ndarray) -> bool:
    """Whether a ray from a point crosses a closed polygon an odd number of times."""
    (x, y), (u, v) = polygon.T, np.roll(polygon, -1, axis=0).T
    spans = (y > point[1]) != (v > point[1])
    at = x[spans] + (point[1] - y[spans]) * (u - x)[spans] / (v - y)[spans]
    return bool(np.count_nonzero(at > point[0]) % 2)


def _runs(good: np.ndarray) -> np.ndarray:
    """First and past-the-last index of each stretch of True, shape [count, 2]."""
    return np.flatnonzero(np.diff(np.concatenate([[0], good.astype(np.int8), [0]]))).reshape(-1, 2)


def _longest_run(good: np.ndarray) -> tuple[int, int]:
    """First and past-the-last index of the longest stretch of True."""
    runs = _runs(good)
    first, last = runs[np.argmax(runs[:, 1] - runs[:, 0])] if len(runs) else (0, 0)
    return int(first), int(last)


def _without(lines: list[_Line], dropped: int) -> list[_Line]:
    """The lines less one and all that forks off it."""
    number: dict[int, int] = {-1: -1}
    kept: list[_Line] = []
    for index, line in enumerate(lines):  # a parent comes before its children
        if index != dropped and line.parent in number:
            number[index] = len(kept)
            kept.append(replace(line, parent=number[line.parent], forks=[]))
    for line in kept:
        if line.parent >= 0 and 0.0 < line.parent_arc < kept[line.parent].length:
            kept[line.parent].forks.append(line.parent_arc)
    return kept


def _cut(lines: list[_Line]) -> VeinLines:
    """The lines cut into pieces [edges], a fork being one point of both lines."""
    points: list[np.ndarray] = []
    pieces: list[tuple[int, int]] = []
    flow: list[float] = []
    owner: list[int] = []
    numbers: list[dict[float, int]] = []
    at_base = -1
    for index, line in enumerate(lines):
        arcs = line.nodes()
        own: dict[float, int] = {}
        for arc in arcs.tolist():
            if line.parent >= 0 and arc == 0.0:
                own[arc] = _fork_number(numbers[line.parent], line.parent_arc)
                continue
            own[arc] = len(points)
            points.append(line.at(arc))
        numbers.append(own)
        if line.starts_at_base:
            at_base = own[0.0]
        feeds = np.interp(arcs, line.arc, line.flow)
        pieces += pairwise(own.values())
        flow += (0.5 * (feeds[:-1] + feeds[1:])).tolist()
        owner += [index] * (len(arcs) - 1)
    if not pieces:
        return NO_LINES
    return VeinLines(np.array(points), np.array(pieces), np.array(flow), np.array(owner), at_base)


def _fork_number(numbers: dict[float, int], arc: float) -> int:
    return numbers[min(numbers, key=lambda known: abs(known - arc))]
