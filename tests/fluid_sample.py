"""Small fluids for tests: drawn maps instead of a photo, and float64 references of the diffusion step."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sparse

from leafwarp.leaf.leaf import Leaf, MapFrame
from leafwarp.scene import Scene
from leafwarp.scene.file import parse_scene
from leafwarp.sim.fluid import Fluid
from leafwarp.sim.launch import State
from leafwarp.sim.plan import make_stages
from leafwarp.sim.stage import Stage

# "iterated" stands for the unsplit scheme by conjugate gradients.
SCHEMES = ("split", "unsplit", "iterated")
STAGES = {"split": "split_diffusion", "unsplit": "factored_diffusion", "iterated": "unsplit_diffusion"}


@dataclass
class Sample:
    """A fluid on drawn maps."""

    scene: Scene
    leaf: Leaf
    state: State
    stages: dict[str, Stage]
    fluid: Fluid

    @property
    def water(self) -> np.ndarray:
        return self.state["water"].numpy().astype(np.float64)

    @property
    def leaf_water(self) -> np.ndarray:
        return self.water[self.leaf.mask]

    def set_water(self, content: np.ndarray) -> None:
        self.state.upload("water", content)

    def step(self, name: str, index: int = 0) -> np.ndarray:
        """Run one stage, after the source where there is one; the water after it."""
        for each in dict.fromkeys(("source", name)):
            if each in self.stages:
                self.stages[each].run(self.fluid.steps.interval(index))
        return self.water


def make_scene(tables: dict, precision: str = "float32") -> Scene:
    base = {
        "leaf": {"image": "leaf.png", "length": 0.1},
        "time": {"duration": 600.0, "frames": 11},
        "structure": {"membrane_stiffness": 10.0},
        "solver": {"precision": precision},
    }
    if tables.get("fluid", {}).get("scheme") == "iterated":
        tables = tables | {"fluid": tables["fluid"] | {"scheme": "unsplit", "solver": "conjugate_gradients"}}
    return parse_scene(base | tables, "sample", Path("."))


def make_sample(
    tables: dict,
    mask: np.ndarray,
    maps: dict[str, np.ndarray] | None = None,
    size: tuple[float, float] = (0.1, 0.1),
    device: str = "cpu",
    precision: str = "float32",
) -> Sample:
    """The fluid of a scene on these maps. Water is 1 at the start where the maps hold none."""
    scene = make_scene(tables, precision)
    maps = {"water": np.ones(mask.shape)} | (maps or {})
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
    fluid: dict | None = None,
) -> Sample:
    """Diffusion alone, with a diffusivity for each cell; cells are 1 m wide unless a size says otherwise."""
    most = max(float(diffusivity.max()), 1e-300)
    table = {"step": step, "scheme": scheme, "lamina_diffusivity": 0.0, "vein_diffusivity": most} | (fluid or {})
    tables = {"fluid": table, "time": {"duration": 1000 * step, "frames": 2}}
    maps = {"venation": diffusivity / most, "water": water}
    size = size or (mask.shape[1], mask.shape[0])
    return make_sample(tables, mask, maps, size, device, precision)


def stage_name(scheme: str) -> str:
    return STAGES[scheme]


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


def petiole_leaf(count: int, direction: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """A round blade with a midrib on a thin petiole, drawn from its foot along x, y or the diagonal.

    Returns:
        The mask, and the maps of venation (the petiole and its midrib) and source (the petiole's foot).
    """
    centre = (np.arange(count) + 0.5) / count - 0.5
    x, y = np.meshgrid(centre, centre)
    angle = np.radians({"x": 0.0, "diagonal": 45.0, "y": 90.0}[direction])
    along = x * np.cos(angle) + y * np.sin(angle) + 0.4
    across = np.abs(y * np.cos(angle) - x * np.sin(angle))
    petiole = (across < 0.04) & (along >= 0.0) & (along < 0.6)
    mask = petiole | (np.hypot(along - 0.6, across) < 0.25)
    midrib = (along < 0.75) * np.clip((0.04 - across) * count + 0.5, 0.0, 1.0)
    return mask, {"venation": midrib * mask, "source": (petiole & (along < 0.06)).astype(float)}


def random_diffusivity(rng: np.random.Generator, shape: tuple[int, int], decades: tuple[float, float]) -> np.ndarray:
    """Diffusivities over many decades, a fifth of the cells dead."""
    diffusivity = 10.0 ** rng.uniform(*decades, shape)
    diffusivity[rng.random(shape) < 0.2] = 0.0
    return diffusivity
