"""A leaf's shape, and the fields (coverage, veins, network) that shading needs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .curves import Placement, ribbon
from .outline import Margin, Petiole, Run, Teeth
from .raster import cell_network, coverage
from .venation import Rib, Secondary, Venation, branches, rib_secondaries, to_tip


@dataclass(frozen=True)
class Network:
    """Cell sizes, in leaf lengths, of the ladder between secondaries and of the finest mesh inside it."""

    ladder: tuple[float, float]
    mesh: tuple[float, float]


@dataclass(frozen=True)
class Parallel:
    """Veins side by side from base to tip, as in grasses."""

    pairs: int
    midrib_width: float
    width: float


@dataclass(frozen=True)
class LeafShape:
    """What a leaf looks like, apart from its colours: all lengths in lamina lengths."""

    seed: int
    placement: Placement
    half_outline: tuple[Run, ...]  # the right half, base to tip: smooth runs that meet in corners
    petiole: Petiole | None
    network: Network
    ribs: tuple[Rib, ...] = ()
    parallel: Parallel | None = None
    teeth: Teeth | None = None
    asymmetry: float = 0.03  # how much wider the right half is than the left, each way
    wobble: float = 0.0009  # unsteadiness of the veins' course


class LeafFields:
    """Rasters of one leaf, each float32 of the picture's shape."""

    def __init__(self, shape: LeafShape):
        """Grows the veins and the margin; rasters are made when they are asked for."""
        self.shape = shape
        self.rng = np.random.default_rng(shape.seed)
        self.size = (shape.placement.height, shape.placement.width)
        self.margins = {side: Margin(shape.half_outline, side, 1.0 + side * shape.asymmetry) for side in (-1, 1)}
        self.venation = Venation(self.rng, shape.wobble)
        if shape.parallel is not None:
            self._grow_parallel(shape.parallel)
        else:
            self._grow_ribs()

    @cached_property
    def lamina(self) -> np.ndarray:
        """Coverage of the blade without its petiole."""
        outline = np.concatenate([self.margins[1].toothed, self.margins[-1].toothed[::-1]])
        return coverage([self.shape.placement.to_picture(outline)], self.size)

    @cached_property
    def petiole(self) -> np.ndarray:
        """Coverage of the petiole, none where the leaf has a sheath."""
        if self.shape.petiole is None:
            return np.zeros(self.size, np.float32)
        stalk = ribbon(self.shape.petiole.curve(), self.shape.petiole.widths())
        return coverage([self.shape.placement.to_picture(stalk)], self.size)

    @cached_property
    def coordinates(self) -> tuple[np.ndarray, np.ndarray]:
        """Leaf coordinates (x, y) of every pixel."""
        return self.shape.placement.leaf_coordinates()

    def veins(self, order: int) -> np.ndarray:
        """Coverage of the veins of one order."""
        polygons = [self.shape.placement.to_picture(polygon) for polygon in self.venation.polygons(order)]
        return coverage(polygons, self.size)

    def network(self, cells: tuple[float, float]) -> np.ndarray:
        """Distance in pixels to the nearest vein of a fine network with the given cell size."""
        inside = self.lamina > 0.0
        x, y = (values[inside] for values in self.coordinates)
        u, v = self._network_coordinates(x, y)
        field = np.full(self.size, 1e3, np.float32)
        field[inside] = cell_network(u, v, *cells, self.rng) * self.shape.placement.scale
        return field

    def half_width(self, y: np.ndarray) -> np.ndarray:
        """Distance from the axis to the right margin at height y."""
        smooth = self.margins[1].smooth
        return np.interp(y, smooth[:, 1], smooth[:, 0])

    def _network_coordinates(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self.shape.parallel is not None:
            across = x / np.maximum(self.half_width(y), 1e-3)
            return across * np.max(self.margins[1].smooth[:, 0]), y
        u, v = np.zeros_like(x), np.zeros_like(y)
        owner = self._owner(x, y)
        for index, rib in enumerate(self.shape.ribs):
            own = owner == index
            u[own], v[own] = rib.network_coordinates(x[own], y[own])
            v[own] += 3.7 * index
        return u, v

    def _owner(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Index of the rib whose sector holds each point."""
        bearing = np.degrees(np.arctan2(x, y))
        return np.argmin([np.abs(bearing - rib.direction) for rib in self.shape.ribs], axis=0)

    def _grow_ribs(self) -> None:
        grown = []
        for index, rib in enumerate(self.shape.ribs):
            found = rib_secondaries(rib, self.margins, self.rng)
            grown.append([self._inside_sector(secondary, index) for secondary in found])
        if self.shape.teeth is not None:
            self._cut_teeth(self.shape.teeth, [secondary for found in grown for secondary in found])
        for rib, found in zip(self.shape.ribs, grown, strict=True):
            along = np.linspace(0.0, rib.length * 0.995, 240)
            self.venation.add(rib.to_leaf(along, 0.0 * along), 0, rib.width, 0.0012)
            for secondary in found:
                if secondary.place is None or self.shape.teeth is None:
                    curve = secondary.curve[: max(12, int(0.97 * len(secondary.curve)))]
                    self.venation.add(curve, 1, rib.secondary_width, 0.0006, 0.9)
                else:
                    self._grow_toothed(rib, secondary, self._basal_limit(rib, secondary, found))

    def _inside_sector(self, secondary: Secondary, rib: int) -> Secondary:
        """The secondary, ended where it enters another rib's sector, if it does."""
        outside = self._owner(secondary.curve[4:, 0], secondary.curve[4:, 1]) != rib
        if not outside.any():
            return secondary
        return Secondary(secondary.curve[: int(np.argmax(outside)) + 4], secondary.half, None)

    def _cut_teeth(self, teeth: Teeth, secondaries: list[Secondary]) -> None:
        for side, margin in self.margins.items():
            anchors = [item.place for item in secondaries if item.half == side and item.place is not None]
            anchors += [self._tip(rib, side) for rib in self.shape.ribs if rib.direction * side > 0]
            margin.cut_teeth(teeth, np.array(anchors), self.rng)

    def _tip(self, rib: Rib, side: int) -> float:
        """Arc length along one half of the margin nearest to the rib's tip."""
        return self.margins[side].nearest(rib.to_leaf(rib.length, 0.0))[1]

    def _basal_limit(self, rib: Rib, secondary: Secondary, found: list[Secondary]) -> float:
        """Arc length up to which a secondary branches: part of the way to the next one toward the base."""
        half, place = secondary.half, secondary.place
        basal = -1.0 if place <= self._tip(rib, half) else 1.0
        gaps = [(o.place - place) * basal for o in found if o.half == half and o.place is not None]
        return place + basal * 0.58 * min([gap for gap in gaps if gap > 0.0] + [0.22])

    def _grow_toothed(self, rib: Rib, secondary: Secondary, limit: float) -> None:
        margin, place = self.margins[secondary.half], secondary.place
        curve = to_tip(secondary.curve, margin.at(place))
        width = rib.secondary_width
        share = min(1.0, 0.45 + len(curve) / 400)
        self.venation.add(curve, 1, width * share, width * 0.28)
        for fork, branch in branches(curve, place, margin, limit):
            self.venation.add(branch, 2, width * share * (0.72 - 0.35 * fork), width * 0.16)

    def _grow_parallel(self, veins: Parallel) -> None:
        y = np.linspace(self.margins[1].smooth[:, 1].min(), 0.995, 500)
        half_width = self.half_width(y)
        midrib = np.stack([np.zeros_like(y), y], axis=1)
        self.venation.add(midrib, 0, veins.midrib_width, veins.midrib_width * 0.08, 0.7)
        for index in (sign * step for step in range(1, veins.pairs + 1) for sign in (-1, 1)):
            across = (index + self.rng.uniform(-0.12, 0.12)) / (veins.pairs + 0.45)
            last = 0.985 - 0.25 * abs(across) ** 2 * self.rng.uniform(0.6, 1.0)
            line = np.stack([across * half_width, y], axis=1)[y < last]
            order = 1 if index % 3 == 0 else 2
            self.venation.add(line, order, veins.width * (1.0 if order == 1 else 0.6), veins.width * 0.35)
