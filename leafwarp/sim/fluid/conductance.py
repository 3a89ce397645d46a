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
    limit = _largest(time_step)
    x = np.zeros(mask.shape)
    y = np.zeros(mask.shape)
    with np.errstate(over="ignore"):
        x[:, :-1] = (0.5 * diffusivity[:, 1:] + 0.5 * diffusivity[:, :-1]) / cell_size[0] ** 2
        y[:-1] = (0.5 * diffusivity[1:] + 0.5 * diffusivity[:-1]) / cell_size[1] ** 2
    x[:, :-1][~(mask[:, 1:] & mask[:, :-1])] = 0.0
    y[:-1][~(mask[1:] & mask[:-1])] = 0.0
    return FaceConductance(np.minimum(x, limit), np.minimum(y, limit))


def _largest(time_step: float) -> float:
    return min(MAXIMUM_BETA / time_step, MAXIMUM_BETA)


def leaf_conductance(scene: Scene, leaf: Leaf, time_step: float) -> FaceConductance:
    """The conductance of a leaf: ``D = D_lamina + (D_vein - D_lamina) * venation``."""

    def photo_faces(photo: Leaf) -> FaceConductance:
        rows, columns = photo.mask.shape
        cell_size = (photo.frame.size[0] / columns, photo.frame.size[1] / rows)
        return face_conductance(_diffusivity(scene, photo), photo.mask, cell_size, time_step)

    faces = once_a_photo(photo_faces)

    def sized(photo: Leaf, specimen: Specimen, direction: str) -> np.ndarray:
        return np.minimum(getattr(faces(photo, specimen), direction) / specimen.size**2, _largest(time_step))

    x, y = (leaf.tile(lambda photo, specimen, d=direction: sized(photo, specimen, d)) for direction in ("x", "y"))
    return FaceConductance(x, y)


def _diffusivity(scene: Scene, leaf: Leaf) -> np.ndarray:
    lamina, vein = scene.fluid.lamina_diffusivity, scene.fluid.vein_diffusivity
    if vein == lamina:
        return np.full(leaf.mask.shape, lamina)
    venation = np.clip(leaf.maps["venation"], 0.0, 1.0)
    return (1.0 - venation) * lamina + venation * vein
