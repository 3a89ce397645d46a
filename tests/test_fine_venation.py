"""What finer veins under the same cells are worth: the water of a real scene, from map to map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from conftest import SCENES
from leafwarp.leaf.leaf import Leaf
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.sim.fluid import Fluid
from leafwarp.sim.launch import State
from leafwarp.sim.plan import make_stages

COARSE, FINE = 96, 384  # cells across; those of the second are drawn on twice as many
STEPS = 24


def scene_of(name: str, cells: int) -> Scene:
    scene = load_scene(SCENES / f"{name}.toml")
    fluid = {"fluid.scheme": "unsplit", "fluid.step": scene.time.duration / STEPS}
    return scene.with_changes({"maps.size": cells, "output.contact_sheet": False} | fluid)


def film(scene: Scene, leaf: Leaf, device: str) -> np.ndarray:
    """Relative water content at the end of each step, shape [steps, ny, nx]."""
    stages = make_stages(scene, leaf, "fluid")[0]
    state = State([spec for stage in stages for spec in stage.arrays], device, scene.solver.precision)
    for stage in stages:
        stage.bind(state)
    fluid, contents = Fluid(scene, leaf, state, list(stages)), []
    for step in range(1, STEPS + 1):
        fluid.advance(scene.time.duration * step / STEPS)
        contents.append(state["water"].numpy().astype(np.float64))
    return np.array(contents)


def averaged(contents: np.ndarray, mask: np.ndarray, times: int) -> tuple[np.ndarray, np.ndarray]:
    """Means over the leaf cells of blocks of so many cells each way, and their number in each block."""
    rows, columns = (side // times for side in mask.shape)
    counts = mask.reshape(rows, times, columns, times).sum((1, 3))
    sums = (contents * mask).reshape(-1, rows, times, columns, times).sum((2, 4))
    return sums / np.maximum(counts, 1), counts


@pytest.mark.parametrize("name", ["bramble", pytest.param("cut", marks=pytest.mark.slow)])
def test_veins_drawn_on_finer_cells_bring_coarse_maps_nearer_to_fine_ones(name: str, scene_leaf, device: str) -> None:
    leaf = scene_leaf(scene_of(name, FINE))
    assert leaf.fine_venation.shape == (2 * FINE, 2 * FINE)
    expected, counts = averaged(film(scene_of(name, FINE), leaf, device), leaf.mask, FINE // COARSE)
    coarse = scene_leaf(scene_of(name, COARSE))
    assert coarse.fine_venation.shape == (4 * COARSE, 4 * COARSE)
    inside = coarse.mask & (counts > 0)
    errors = []
    for known in (coarse, replace(coarse, fine_venation=None)):
        difference = film(scene_of(name, COARSE), known, device) - expected
        errors.append(np.linalg.norm(difference[:, inside]) / np.linalg.norm(expected[:, inside]))
    # Measured 0.030 against 0.083 and, of cut, against 0.072.
    assert errors[0] < 0.05 and errors[0] < 0.6 * errors[1]


def test_a_scene_without_flow_along_veins_keeps_no_finer_ones(scene_leaf) -> None:
    scene = scene_of("bramble", 48)
    even = scene.with_changes({"fluid.vein_diffusivity": scene.fluid.lamina_diffusivity})
    assert "venation" in even.map_names and not even.flow_has_veins
    assert scene_leaf(scene).fine_venation is not None and scene_leaf(even).fine_venation is None
    np.testing.assert_array_equal(scene_leaf(scene).maps["venation"], scene_leaf(even).maps["venation"])
