"""The clamped plate that the springs and hinges stand for as a mesh is refined: a reference without triangles.

Its energy is that of a thin shell in large rotation and small strain (Koiter 1966),

    E = integral of  1/2 e : C(E h, 1/3) : e  +  1/2 (b - k I) : C(D, -1/3) : (b - k I)  +  weight z,

with Green's strain ``e_ab = (x_a . x_b - delta_ab) / 2`` and the curvatures ``b_ab = (x_1 x x_2) . x_ab``, whose normal
has the length 1 but for the strain. ``C(Y, nu)`` is the law of a plane sheet. A lattice of equal springs has the
Poisson ratio 1/3 in its plane, the hinges' is -1/3. The positions are Legendre polynomials of both coordinates
(Ritz 1909), the integrals Gauss sums, and the minimum is found by Newton's method. A straight step stretches all that
it turns; so the stress in the Hessian is the one that the step before foretold (Magisano, Leonetti and Garcea 2017).

Lengths are in lengths of the plate, energies in its bending stiffness ``D``.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.polynomial import Legendre
from numpy.polynomial.legendre import leggauss

from leafwarp.errors import LeafwarpError

MEMBRANE_POISSON, BENDING_POISSON = 1.0 / 3.0, -1.0 / 3.0
MOST_ITERATIONS = 60
LAST_STEP = 1e-9
GROWTH = 2.5  # factor between two loads of which the second starts from the first's shape
SOFTEST = 0.03  # share of a load at which the first shape is flat enough to start from
# Derivatives along the plate and across it that the energy is made of.
DERIVATIVES = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
# Which of them gives the curvature along, across and mixed, by its row among the strains.
SECOND = {3: 2, 4: 4, 5: 3}


class Plate:
    """A plate of length 1, clamped at ``s = 0``, symmetric about its middle line.

    Args:
        width: Over its length.
        slenderness: Length over thickness.
        along: Number of polynomials along it.
        across: Number of polynomials across it.
    """

    def __init__(self, width: float, slenderness: float, along: int = 16, across: int = 6):
        self._half, self._along, self._across = 0.5 * width, along, across
        s, weights_s = leggauss(along + 8)
        y, weights_y = leggauss(2 * across + 4)
        s, y, weights_y = 0.5 * (s + 1.0), self._half * y[y > 0.0], width * weights_y[y > 0.0]
        self._weights = np.outer(0.5 * weights_s, weights_y).ravel()
        s, y = (grid.ravel() for grid in np.meshgrid(s, y, indexing="ij"))
        self._heights = self._basis(2, s, y, (0, 0))
        self._bases = [np.stack([self._basis(axis, s, y, each) for each in DERIVATIVES], axis=1) for axis in range(3)]
        stretching = 12.0 * (1.0 - BENDING_POISSON**2) * slenderness**2
        self._law = np.zeros((6, 6))
        self._law[:3, :3] = _plane_law(stretching / (1.0 - MEMBRANE_POISSON**2), MEMBRANE_POISSON)
        self._law[3:, 3:] = _plane_law(1.0, BENDING_POISSON)
        self._coefficients = np.zeros((3, along * across))

    def _basis(self, axis: int, s: np.ndarray, y: np.ndarray, derivative: tuple[int, int]) -> np.ndarray:
        """Derivatives of the polynomials of a coordinate at places, shape [place_count, polynomial_count].

        At the clamp the displacements vanish, and that along z does with its slope; that along y is odd in y.
        """
        domain, side = (0.0, 1.0), (-self._half, self._half)
        root = Legendre([0.5, 0.5], domain) ** (2 if axis == 2 else 1)  # s, or its square
        along = [root * Legendre.basis(degree, domain) for degree in range(self._along)]
        across = [Legendre.basis(2 * degree + (axis == 1), side) for degree in range(self._across)]
        values = (
            np.stack([polynomial.deriv(order)(places) for polynomial in polynomials], axis=1)
            for polynomials, places, order in ((along, s, derivative[0]), (across, y, derivative[1]))
        )
        return np.einsum("pi,pj->pij", *values).reshape(len(s), -1)

    def points(self, s: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Where places along and across it are now, shape [place_count, 3]."""
        moved = [self._basis(axis, s, y, (0, 0)) @ self._coefficients[axis] for axis in range(3)]
        return np.column_stack((s + moved[0], y + moved[1], moved[2]))

    def bend(self, weight: float = 0.0, natural_curvature: float = 0.0) -> None:
        """Bring it to rest, downhill from where it is.

        Args:
            weight: ``sigma g L^3 / D``.
            natural_curvature: The same along and across, times the length.

        Raises:
            LeafwarpError: No rest was found.
        """
        count, foretold = self._coefficients.shape[1], None
        natural = natural_curvature * np.array([0.0, 0.0, 0.0, 1.0, 1.0, 0.0])
        for _ in range(MOST_ITERATIONS):
            vectors = np.stack([basis @ c for basis, c in zip(self._bases, self._coefficients, strict=True)], axis=2)
            vectors[:, 0, 0] += 1.0
            vectors[:, 1, 1] += 1.0
            strains, slopes = _strains(vectors)
            stress = (strains - natural) @ self._law
            hessian = slopes.transpose(0, 2, 1) @ (self._law @ slopes)
            hessian += _curving(vectors, stress if foretold is None else foretold)
            gradient = np.einsum("qr,qra,q->qa", stress, slopes, self._weights).reshape(-1, 5, 3)
            hessian = (hessian * self._weights[:, None, None]).reshape(-1, 5, 3, 5, 3)
            flat = [basis.reshape(-1, count) for basis in self._bases]
            force = np.concatenate([flat[k].T @ gradient[:, :, k].ravel() for k in range(3)])
            force[2 * count :] += weight * (self._weights @ self._heights)
            matrix = np.block(
                [
                    [flat[k].T @ (hessian[:, :, k, :, m] @ self._bases[m]).reshape(-1, count) for m in range(3)]
                    for k in range(3)
                ]
            )
            step = np.linalg.solve(matrix, -force).reshape(3, count)
            change = np.stack([basis @ c for basis, c in zip(self._bases, step, strict=True)], axis=2)
            foretold = stress + np.einsum("qra,qa->qr", slopes, change.reshape(-1, 15)) @ self._law
            self._coefficients = self._coefficients + step
            turned = float(np.abs(change[:, :2]).max())
            if turned <= LAST_STEP:
                return
        raise LeafwarpError(f"the plate found no rest: its last step turned it by {turned:.3g} rad")


def _plane_law(stiffness: float, poisson: float) -> np.ndarray:
    """Stress over strain, both as (along, across, mixed), where the energy counts the mixed ones once."""
    return stiffness * np.array([[1.0, poisson, 0.0], [poisson, 1.0, 0.0], [0.0, 0.0, 2.0 * (1.0 - poisson)]])


def _strains(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Strains and curvatures, shape [place_count, 6], and their derivatives, shape [place_count, 6, 15].

    Args:
        vectors: Derivatives of the positions, shape [place_count, 5, 3].
    """
    first, second = vectors[:, 0], vectors[:, 1]
    normal = np.cross(first, second)
    strains = np.empty((len(vectors), 6))
    slopes = np.zeros((len(vectors), 6, 5, 3))
    strains[:, 0] = 0.5 * ((first**2).sum(axis=1) - 1.0)
    strains[:, 1] = 0.5 * ((second**2).sum(axis=1) - 1.0)
    strains[:, 2] = 0.5 * (first * second).sum(axis=1)
    slopes[:, 0, 0], slopes[:, 1, 1] = first, second
    slopes[:, 2, 0], slopes[:, 2, 1] = 0.5 * second, 0.5 * first
    for row, place in SECOND.items():
        bend = vectors[:, place]
        strains[:, row] = (normal * bend).sum(axis=1)
        slopes[:, row, 0], slopes[:, row, 1] = np.cross(second, bend), np.cross(bend, first)
        slopes[:, row, place] = normal
    return strains, slopes.reshape(-1, 6, 15)


def _curving(vectors: np.ndarray, stress: np.ndarray) -> np.ndarray:
    """Stress times the second derivatives of the strains, shape [place_count, 15, 15]."""
    result = np.zeros((len(vectors), 5, 3, 5, 3))
    result[:, 0, :, 0] += stress[:, 0, None, None] * np.eye(3)
    result[:, 1, :, 1] += stress[:, 1, None, None] * np.eye(3)
    shear = 0.5 * stress[:, 2, None, None] * np.eye(3)
    result[:, 0, :, 1] += shear
    result[:, 1, :, 0] += shear
    for row, place in SECOND.items():
        for one, other, vector, sign in (
            (0, 1, vectors[:, place], -1.0),
            (0, place, vectors[:, 1], 1.0),
            (1, place, vectors[:, 0], -1.0),
        ):
            block = sign * stress[:, row, None, None] * _cross_matrix(vector)
            result[:, one, :, other] += block
            result[:, other, :, one] += block.transpose(0, 2, 1)
    return result.reshape(-1, 15, 15)


def _cross_matrix(vectors: np.ndarray) -> np.ndarray:
    """Matrices that take a vector to the cross product with it, shape [count, 3, 3]."""
    return np.cross(vectors[:, None, :], np.eye(3)[None, :, :]).transpose(0, 2, 1)


@cache
def plate_drops(width: float, slenderness: float, weights: tuple[float, ...]) -> dict[float, float]:
    """Mean drop of the free end under rising weights, over the length.

    Args:
        width: Over the length.
        slenderness: Length over thickness.
        weights: ``sigma g L^3 / D``, rising.
    """
    plate, drops, before = Plate(width, slenderness), {}, weights[0]
    y = width * np.linspace(-0.5, 0.5, 41)
    for weight in weights:
        steps = max(1, int(np.ceil(np.log(weight / before) / np.log(GROWTH))))
        for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
            plate.bend(before * (weight / before) ** share)
        before = weight
        drops[weight] = float(-np.trapezoid(plate.points(np.ones_like(y), y)[:, 2], y) / width)
    return drops


def rolled_plate(width: float, slenderness: float, natural_curvature: float, **size: int) -> Plate:
    """A plate without weight whose two layers want the same curvature both ways, times the length."""
    plate = Plate(width, slenderness, **size)
    steps = int(np.ceil(np.log(1.0 / SOFTEST) / np.log(GROWTH)))
    for share in np.geomspace(SOFTEST, 1.0, steps + 1):
        plate.bend(natural_curvature=share * natural_curvature)
    return plate
