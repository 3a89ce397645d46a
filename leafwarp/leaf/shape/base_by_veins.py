"""The petiole's end: the end of the stalk, or the point of the margin, that the veins lead to.

Candidates all along the margin, and the feet of what may be a stalk, are scored together
(:mod:`leafwarp.leaf.shape.base_cues`). The cost of carrying water from a candidate to every part of the leaf along
its veins counts too, as the base is where it is least. A stalk's slenderness is a bonus that seldom fails; but the
veins must not contradict it outright, or a sliver of shadow along the margin would pass for a petiole.
"""

from __future__ import annotations

import numpy as np

from leafwarp.leaf.image.photo import Photo
from leafwarp.leaf.shape.base_cues import (
    end_breadth,
    line_directions,
    mirror_symmetry,
    parallel_share,
    tooth_lean,
    vein_signs,
)
from leafwarp.leaf.shape.curve import resample_closed
from leafwarp.leaf.shape.pixel_graph import pixel_graph
from leafwarp.leaf.shape.stalk import Stalk
from leafwarp.leaf.shape.window import window_around

AREA = 32_000  # [pixels] of the leaf in the window that lines are sought in: only the main veins matter
COARSE_AREA = 6_000  # the same for the costs of carrying
CANDIDATES = 120  # along the margin
COSTED = 24  # the best of them, by lines and shape
REFINEMENTS, REFINED = 2, 32  # rounds, and candidates about the best one in each
REFINED_WITHIN = 0.08  # of the extent: how far from it
COST_FLOOR, COST_POWER = 0.03, 1.5  # as for the vein tree
COST_WEIGHT = 0.2  # of the logarithm of the mean cost, beside slant and radiation
TOOTH_WEIGHT, SYMMETRY_WEIGHT, LENGTH_WEIGHT = 0.15, 0.5, 0.1  # shape decides where veins do not show
BREADTH_WEIGHT = 0.25  # of the broader end
PARALLEL_BONUS, PARALLEL_BREADTH = 0.3, 0.4  # of parallel veins along the leaf, and of its broader end then
CUT_WITHIN = 0.008  # of the extent: nearer to the photo's border than this a leaf is cut by it
OUTWARDS_WEIGHT = 0.5  # of lying farther out, in extents: a base sticks out, unless it is at the end of a notch
NOTCH = 0.54  # share of leaf around a point from which it lies in a notch
STALK_WEIGHT, STALK_FROM, STALK_FULL = 0.12, 0.6, 6.0  # a stalk's bonus by its slenderness
STALK_WIDEST = 0.25  # share of the blade's width; a part wider than that is a lobe,
SHEATH_WIDEST, SHEATH_LENGTH = 0.4, 0.1  # or the sheath of a narrow blade, at least this share of the extent long
SNAP, SNAP_FROM = 0.6, 0.01  # a stalk's end is the base where it is so near: share of its length, of the extent


def base_by_veins(photo: Photo, outline: np.ndarray, stalks: list[Stalk]) -> tuple[np.ndarray, Stalk | None]:
    """The best candidate in photo pixels (x, y), and the stalk whose end it is, if any.

    Args:
        photo: The picture.
        outline: Closed polygon of the leaf in photo pixels, shape [count, 2].
        stalks: Parts that may be the petiole.
    """
    scorer = _Scorer(photo, outline)
    kept = [stalk for stalk in stalks if _may_be_petiole(stalk)]
    margin = resample_closed(scorer.polygon, CANDIDATES * 8)[::8]
    feet = scorer.window.from_photo(np.array([stalk.foot for stalk in kept]).reshape(-1, 2))
    candidates = np.concatenate([margin, feet])
    bonus = np.zeros(len(candidates))
    slenderness = np.array([stalk.slenderness for stalk in kept])
    bonus[len(margin) :] = STALK_WEIGHT * (np.minimum(slenderness, STALK_FULL) - STALK_FROM)
    scores = scorer.score(candidates, ends=True) + bonus
    chosen = np.argsort(-scores, kind="stable")[:COSTED]
    best = int(chosen[np.argmax(scores[chosen] + scorer.ease(candidates[chosen]))])
    if best >= len(margin):
        stalk = kept[best - len(margin)]
        return stalk.end, stalk
    found = scorer.window.to_photo(scorer.middle_of_cut(scorer.refine(candidates[best]), photo.size))
    for stalk in kept:
        near = (SNAP * stalk.length + SNAP_FROM) * scorer.window.extent / scorer.window.scale
        if min(np.linalg.norm(found - stalk.foot), np.linalg.norm(found - stalk.end)) < near:
            return stalk.end, stalk
    return found, None


def _may_be_petiole(stalk: Stalk) -> bool:
    widest = SHEATH_WIDEST if stalk.length >= SHEATH_LENGTH else STALK_WIDEST
    return stalk.thinness <= widest and stalk.slenderness > STALK_FROM


class _Scorer:
    """What is known of one leaf, to score candidates for its base (window points) by."""

    def __init__(self, photo: Photo, outline: np.ndarray) -> None:
        import cv2

        from leafwarp.leaf.venation.likelihood import vein_likelihood

        self.window = window_around(outline, AREA)
        self.polygon = self.window.from_photo(outline)
        colours = self.window.colours(photo.colour)
        self.directions = line_directions(colours, self.window.inside)
        likelihood = vein_likelihood(colours, self.window.inside)
        shrink = np.sqrt(COARSE_AREA / AREA)
        size = tuple(np.rint(np.array(likelihood.shape[::-1]) * shrink).astype(int).tolist())
        self.to_coarse = np.divide(size, likelihood.shape[::-1])
        coarse = cv2.resize(likelihood, size, interpolation=cv2.INTER_AREA)
        # A petiole narrower than a pixel must not fall apart: any coverage counts.
        covered = cv2.resize(self.window.inside.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.05
        self.graph = pixel_graph(covered, (COST_FLOOR + coarse) ** -COST_POWER)

    def score(self, candidates: np.ndarray, ends: bool = False) -> np.ndarray:
        """Signs of veins and symmetry together, shape [count]; differences of 0.1 are plain.

        Args:
            candidates: Window points, shape [count, 2].
            ends: Whether to add which end of the leaf is its base by the proportions of the whole. They tell one
                end from the other, not one point from the next.
        """
        means, radiation = vein_signs(self.directions, candidates)
        scores = means.imag + radiation + SYMMETRY_WEIGHT * mirror_symmetry(self.window.inside, candidates)
        if not ends:
            return scores
        breadth, slenderness = end_breadth(self.window.inside, candidates)
        scores += TOOTH_WEIGHT * tooth_lean(self.polygon, candidates)
        scores += BREADTH_WEIGHT * breadth + LENGTH_WEIGHT * np.log(np.clip(slenderness, 0.5, 4.0))
        # None across a leaf with dense straight side veins.
        parallel = parallel_share(means) * np.clip(2.0 * slenderness - 1.5, 0.0, 1.0)
        return scores + parallel * (PARALLEL_BONUS + PARALLEL_BREADTH * breadth)

    def ease(self, candidates: np.ndarray) -> np.ndarray:
        """Minus the logarithm of the mean cost of carrying from each candidate, weighted, shape [count]."""
        costs = self.graph.costs(self.graph.nearest(candidates * self.to_coarse))
        reached = np.isfinite(costs)
        mean = np.where(reached, costs, 0.0).sum(axis=1) / np.maximum(reached.sum(axis=1), 1)
        return -COST_WEIGHT * np.log(np.maximum(mean, 1e-9))

    def refine(self, best: np.ndarray) -> np.ndarray:
        """The best point of the margin around a candidate, and around that one in turn."""
        fine = resample_closed(self.polygon, 2000)
        middle = self.polygon.mean(axis=0)
        for _ in range(REFINEMENTS):
            within = np.nonzero(np.linalg.norm(fine - best, axis=1) < REFINED_WITHIN * self.window.extent)[0]
            near = np.concatenate([fine[within[:: max(1, len(within) // REFINED)]], best[None]])
            outwards = (near - best) @ (best - middle) / (np.linalg.norm(best - middle) * self.window.extent)
            weight = 0.0 if self.in_notch(best) else OUTWARDS_WEIGHT
            best = near[np.argmax(self.score(near) + weight * outwards)]
        return best

    def in_notch(self, point: np.ndarray) -> bool:
        """Whether most of what surrounds a point of the margin is leaf."""
        height, width = self.window.inside.shape
        y, x = np.ogrid[0.5:height, 0.5:width]
        disc = np.hypot(x - point[0], y - point[1]) < REFINED_WITHIN * self.window.extent
        return bool(disc.any() and self.window.inside[disc].mean() > NOTCH)

    def middle_of_cut(self, best: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        """Where parallel veins cross the photo's border: the middle of the stretch of border that the leaf touches."""
        if parallel_share(vein_signs(self.directions, best[None])[0])[0] < 0.5:
            return best
        fine = resample_closed(self.polygon, 2000)
        low, high = self.window.from_photo(np.zeros(2)), self.window.from_photo(np.array(size, float))
        for axis, border in ((0, low[0]), (0, high[0]), (1, low[1]), (1, high[1])):
            touching = np.abs(fine[:, axis] - border) < CUT_WITHIN * self.window.extent
            if touching.any() and np.abs(best[axis] - border) < 4.0 * CUT_WITHIN * self.window.extent:
                return 0.5 * (fine[touching].min(axis=0) + fine[touching].max(axis=0))
        return best
