"""Fluids on drawn maps instead of a photo's, and what a step of diffusion is in float64."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from leafwarp.leaf.leaf import Leaf, MapFrame
from leafwarp.scene import Scene
from leafwarp.sim.fluid import Fluid
from leafwarp.sim.launch import State
from leafwarp.sim.plan import make_stages
from leafwarp.sim.stage import Stage

# The schemes of diffusion and their stages; "iterated" is the unsplit one by conjugate gradients.
STAGES = {"split": "split_diffusion", "unsplit": "factored_diffusion", "iterated": "unsplit_diffusion"}
# What the unsplit ones say of their solver; "unsplit, solver left open" has the stage that follows from the precision.
SOLVERS = {
    "unsplit": {"solver": "factor"},
    "iterated": {"solver": "conjugate_gradients"},
    "unsplit, solver left open": {},
}
# What names of schemes end with whose steps are of second order.
SECOND_ORDER = ", second order"


@dataclass
class Sample:
    """A fluid on drawn maps, bound to a device."""

    scene: Scene
    leaf: Leaf
    state: State
    stages: dict[str, Stage]
    fluid: Fluid

    @property
    def water(self) -> np.ndarray:
        """Relative water content, float64, shape [ny, nx]."""
        return self.state["water"].numpy().astype(np.float64)

    @property
    def leaf_water(self) -> np.ndarray:
        """The same of the leaf's cells alone, shape [cell_count]."""
        return self.water[self.leaf.mask]

    def set_water(self, content: np.ndarray) -> None:
        """Put other contents in, shape [ny, nx]."""
        self.state.upload("water", content)

    def step(self, name: str, index: int = 0) -> np.ndarray:
        """Run one stage, after the source where there is one; the water after it."""
        before = ("source",) if "source" in self.stages and name != "source" else ()
        for each in (*before, name):
            self.stages[each].run(self.fluid.steps.interval(index))
        return self.water

    def diffuse(self) -> np.ndarray:
        """Run a step of the scene's diffusion, if it has any; the water after it."""
        return self.step(next((name for name in STAGES.values() if name in self.stages), "water"))


def make_scene(tables: Mapping[str, Any], precision: str = "float32") -> Scene:
    """A scene of a leaf that is not read, with further tables; its scheme is one of :data:`STAGES` or `SOLVERS`, which
    :data:`SECOND_ORDER` may follow."""
    base = {
        "leaf": {"image": "leaf.png", "length": 0.1},
        "time": {"duration": 600.0, "frames": 11},
        "structure": {"membrane_stiffness": 10.0},
        "solver": {"precision": precision},
    }
    tables = dict(tables)
    scheme, order, _ = tables.get("fluid", {}).get("scheme", "split").partition(SECOND_ORDER)
    if order:
        tables["fluid"] = tables["fluid"] | {"scheme": scheme, "order": 2}
    if scheme in SOLVERS:
        tables["fluid"] = SOLVERS[scheme] | tables["fluid"] | {"scheme": "unsplit"}
    return Scene.model_validate(base | tables)


def make_sample(
    tables: Mapping[str, Any],
    mask: np.ndarray,
    maps: Mapping[str, np.ndarray] | None = None,
    size: tuple[float, float] = (0.1, 0.1),
    device: str = "cpu",
    precision: str = "float32",
) -> Sample:
    """The fluid of a scene on these maps. Water is 1 at the start where the maps hold none."""
    scene = make_scene(tables, precision)
    maps = {"water": np.ones(mask.shape)} | dict(maps or {})
    leaf = Leaf(None, MapFrame((0.0, 0.0), size), 0.1, None, mask, maps)
    stages = {stage.name: stage for stage in make_stages(scene, leaf, "fluid")[0]}
    state = State([spec for stage in stages.values() for spec in stage.arrays], device, precision)
    for stage in stages.values():
        stage.bind(state)
    return Sample(scene, leaf, state, stages, Fluid(scene, leaf, state, list(stages.values())))


def diffusion_sample(
    diffusivity: np.ndarray,
    mask: np.ndarray,
    water: np.ndarray,
    scheme: str = "split",
    step: float = 1.0,
    size: tuple[float, float] | None = None,
    device: str = "cpu",
    precision: str = "float64",
    fluid: Mapping[str, Any] | None = None,
) -> Sample:
    """Diffusion alone, with a diffusivity for each cell; cells are 1 m wide unless a size says otherwise."""
    most = max(float(diffusivity.max()), 1e-300)
    table = {"step": step, "scheme": scheme, "lamina_diffusivity": 0.0, "vein_diffusivity": most} | dict(fluid or {})
    tables = {"fluid": table, "time": {"duration": 1000 * step, "frames": 2}}
    maps = {"venation": diffusivity / most, "water": water}
    size = size or (mask.shape[1], mask.shape[0])
    return make_sample(tables, mask, maps, size, device, precision)


def exchange_matrices(
    diffusivity: np.ndarray, mask: np.ndarray, step: float, cell: tuple[float, float] = (1.0, 1.0)
) -> tuple[sparse.csc_matrix, sparse.csc_matrix]:
    """``L_x`` and ``L_y`` of a diffusion step, face by face, in float64, for the flattened map."""
    index = np.arange(mask.size).reshape(mask.shape)
    matrices = []
    for axis, width in ((1, cell[0]), (0, cell[1])):
        first = np.take(index, range(mask.shape[axis] - 1), axis).ravel()
        second = np.take(index, range(1, mask.shape[axis]), axis).ravel()
        inside = mask.ravel()[first] & mask.ravel()[second]
        first, second = first[inside], second[inside]
        flat = diffusivity.ravel()
        beta = (flat[first] + flat[second]) / 2.0 * step / width**2
        entries = np.concatenate([beta, beta, -beta, -beta])
        places = (
            np.concatenate([first, second, first, second]),
            np.concatenate([first, second, second, first]),
        )
        matrices.append(sparse.csc_matrix((entries, places), shape=(mask.size, mask.size)))
    return matrices[0], matrices[1]


def ellipse(rows: int, columns: int | None = None) -> np.ndarray:
    """A leaf-shaped mask: an ellipse that fills most of the map, upright."""
    columns = columns or rows
    y = (np.arange(rows) + 0.5) / rows * 2.0 - 1.0
    x = (np.arange(columns) + 0.5) / columns * 2.0 - 1.0
    return (x[None, :] / 0.6) ** 2 + (y[:, None] / 0.95) ** 2 < 1.0


def random_diffusivity(rng: np.random.Generator, shape: tuple[int, int], decades: tuple[float, float]) -> np.ndarray:
    """Diffusivities over many decades, a fifth of the cells dead."""
    diffusivity = 10.0 ** rng.uniform(*decades, shape)
    diffusivity[rng.random(shape) < 0.2] = 0.0
    return diffusivity
