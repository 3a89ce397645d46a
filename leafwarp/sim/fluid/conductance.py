"""How fast neighbouring cells of the map exchange water."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.leaf.specimen import Specimen, once_a_photo
from leafwarp.scene import Scene

# The largest conductance times step that is computed with. Such neighbours have the same content to the last
# bit of a float64 already at 1e16; float32 holds every product with it.
MAXIMUM_BETA = 1e30
# Share of what one half of a cell holds of a vein that the next one must hold for the vein to go on there. A larger
# one throttles thin veins that run diagonally, past the corners of cells: by 8 % at most with this, by 16 % with 0.2.
GOES_ON = 0.05


@dataclass(frozen=True)
class FaceConductance:
    """Rates of exchange over the faces between cells [1/s]; 0 where no water passes.

    Attributes:
        x: Of each cell with its right neighbour, 0 in the last column, shape [ny, nx].
        y: Of each cell with its upper neighbour, 0 in the last row, shape [ny, nx].
    """

    x: np.ndarray
    y: np.ndarray


def face_conductance(
    diffusivity: np.ndarray, mask: np.ndarray, cell_size: tuple[float, float], time_step: float
) -> FaceConductance:
    """``D / dx^2`` at the faces, with the arithmetic mean of the two cells' D, and 0 across the margin.

    The harmonic mean, which suits layers, would throttle a thin vein that runs diagonally over the cells.

    Args:
        diffusivity: Of each cell [m^2/s], shape [ny, nx].
        mask: Cells that are leaf, shape [ny, nx], bool.
        cell_size: Width and height of a cell [m].
        time_step: Fluid step [s]; bounds what is returned.
    """
    beside_x = 0.5 * diffusivity[:, 1:] + 0.5 * diffusivity[:, :-1]
    beside_y = 0.5 * diffusivity[1:] + 0.5 * diffusivity[:-1]
    return _within(beside_x, beside_y, mask, cell_size, time_step)


def _within(
    x: np.ndarray, y: np.ndarray, mask: np.ndarray, cell_size: tuple[float, float], time_step: float
) -> FaceConductance:
    """Conductances of the faces with two leaf cells, from D at those between columns and at those between rows."""
    limit = _largest(time_step)
    with np.errstate(over="ignore"):
        x, y = np.minimum(x / cell_size[0] ** 2, limit), np.minimum(y / cell_size[1] ** 2, limit)
    x, y = np.where(mask[:, 1:] & mask[:, :-1], x, 0.0), np.where(mask[1:] & mask[:-1], y, 0.0)
    return FaceConductance(np.pad(x, ((0, 0), (0, 1))), np.pad(y, ((0, 1), (0, 0))))


def venation_of_faces(fine: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Venation at the faces between the cells of a map, from what is drawn between the cells' centres.

    Most veins are narrower than a cell. Water passes along a vein through faces on both sides of which it is drawn:
    their venation is the mean of the two halves of cells beside them. Where only one of the two holds a vein, it ends
    or runs along the face, and what passes has to cross lamina; the mean of two whole cells, a vein's and its
    neighbour's, would widen every vein by a cell. In between, and where a half holds next to nothing, the one goes
    over into the other, so that a vein conducts the same however it lies between the cells.

    Args:
        fine: Venation of an even number of parts of each cell each way, shape [parts * ny, parts * nx].
        shape: Of the map, [ny, nx].

    Returns:
        That of the faces between columns, shape [ny, nx - 1], and between rows, shape [ny - 1, nx].
    """
    (rows, columns), parts = shape, len(fine) // shape[0]
    across = fine.reshape(rows, parts, columns, 2, parts // 2).mean((1, 4))
    up = fine.reshape(rows, 2, parts // 2, columns, parts).mean((2, 4))
    return _of_halves(across[:, :-1, 1], across[:, 1:, 0]), _of_halves(up[:-1, 1], up[1:, 0])


def _of_halves(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    least, most = np.minimum(first, second), np.maximum(first, second)
    goes_on = np.minimum(least / np.maximum(GOES_ON * most, 1e-300), 1.0)
    return 0.5 * (first + second) * goes_on


def two_cells_wide(venation: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Venation of cells with veins spread to both sides, by half a cell's share; what they carry together stays.

    Args:
        venation: Of each cell, shape [ny, nx].
        mask: Cells that are leaf, shape [ny, nx], bool. Nothing is spread past them.
    """
    spread = np.where(mask, venation, 0.0)
    for values, inside in ((spread, mask), (spread.T, mask.T)):
        passed = np.where(inside[1:] & inside[:-1], 0.25 * np.diff(values, axis=0), 0.0)
        values[:-1] += passed
        values[1:] -= passed
    return spread


def _largest(time_step: float) -> float:
    return min(MAXIMUM_BETA / time_step, MAXIMUM_BETA)


def leaf_conductance(scene: Scene, leaf: Leaf, time_step: float) -> FaceConductance:
    """The conductance of a leaf: ``D = D_lamina + (D_vein - D_lamina) * venation``."""

    def photo_faces(photo: Leaf) -> FaceConductance:
        rows, columns = photo.mask.shape
        cell_size = (photo.frame.size[0] / columns, photo.frame.size[1] / rows)
        if photo.fine_venation is None or not scene.flow_has_veins:
            return face_conductance(_diffusivity(scene, photo), photo.mask, cell_size, time_step)
        if scene.fluid.scheme == "split":
            venation = two_cells_wide(np.clip(photo.maps["venation"], 0.0, 1.0), photo.mask)
            return face_conductance(_mixed(scene, venation), photo.mask, cell_size, time_step)
        venation = venation_of_faces(np.clip(photo.fine_venation, 0.0, 1.0), photo.mask.shape)
        return _within(*(_mixed(scene, values) for values in venation), photo.mask, cell_size, time_step)

    faces = once_a_photo(photo_faces)

    def sized(photo: Leaf, specimen: Specimen, direction: str) -> np.ndarray:
        return np.minimum(getattr(faces(photo, specimen), direction) / specimen.size**2, _largest(time_step))

    x, y = (leaf.tile(lambda photo, specimen, d=direction: sized(photo, specimen, d)) for direction in ("x", "y"))
    return FaceConductance(x, y)


def _diffusivity(scene: Scene, leaf: Leaf) -> np.ndarray:
    if not scene.flow_has_veins:
        return np.full(leaf.mask.shape, scene.fluid.lamina_diffusivity)
    return _mixed(scene, np.clip(leaf.maps["venation"], 0.0, 1.0))


def _mixed(scene: Scene, venation: np.ndarray) -> np.ndarray:
    """``D = D_lamina + (D_vein - D_lamina) * venation``, without a difference that might overflow."""
    return (1.0 - venation) * scene.fluid.lamina_diffusivity + venation * scene.fluid.vein_diffusivity
