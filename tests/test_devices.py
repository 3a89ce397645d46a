"""Whole runs on the device under test: against the CPU, twice alike, through the command line, and freed afterwards."""

from __future__ import annotations

import gc
import json
import weakref
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from leafwarp.cli import main
from leafwarp.scene.file import load_scene
from leafwarp.sim.simulation import Simulation
from leafwarp.usd.check import check_usd

# Of the water, and of the shape as a share of the leaf's length. Roundings of float32, measured up to 3e-7 and 6e-7;
# conjugate gradients stop at their tolerance, in float32 at 1e-5 of the contents' norm: measured up to 4e-5 and 7e-6.
ROUNDING = (1e-6, 2e-6)
ITERATED = (1e-4, 2e-5)


@pytest.mark.parametrize(
    ("changes", "tolerances"),
    [
        ({}, ROUNDING),
        ({"structure.bending": "paper"}, ROUNDING),
        ({"fluid.scheme": "unsplit", "fluid.solver": "factor"}, ROUNDING),
        ({"fluid.scheme": "unsplit", "fluid.solver": "conjugate_gradients"}, ITERATED),
    ],
    ids=["split", "paper bending", "factor", "conjugate gradients"],
)
def test_single_precision_agrees_with_double_on_the_cpu(
    changes: dict, tolerances: tuple, small_scene: Path, scene_leaf, device: str
) -> None:
    scene = load_scene(small_scene).with_changes(changes)
    leaf = scene_leaf(scene)
    here = Simulation(scene.with_changes({"solver.precision": "float32"}), leaf, device)
    exact = Simulation(scene.with_changes({"solver.precision": "float64"}), leaf, "cpu")
    for frame, expected in zip(here.frames(), exact.frames(), strict=True):
        assert np.abs(frame.water - expected.water).max() <= tolerances[0]
        assert np.abs(frame.points - expected.points).max() <= tolerances[1] * leaf.length
    # The leaf has dried and moved a long way by then.
    assert expected.water.max() < 0.8 and np.ptp(expected.points[:, 2]) > 0.2 * leaf.length


def test_two_runs_of_the_command_write_the_same_bytes(
    small_scene: Path, tmp_path: Path, device: str, analysis_anew
) -> None:
    results = []
    for name in ("first", "second"):
        folder = tmp_path / name
        options = ["-q", "--device", device, "--set", "output.contact_sheet=true"]
        assert main(["run", str(small_scene), "-o", str(folder), *options]) == 0
        assert check_usd(folder / "small.usd") == []
        report = json.loads((folder / "small.report.json").read_text())
        assert report["device"]["alias"] == wp.get_device(device).alias
        results.append([(folder / f"small{end}").read_bytes() for end in (".usd", "_contact_sheet.png")])
    assert results[0] == results[1]


def test_the_arrays_of_a_simulation_go_with_it(small_scene: Path, scene_leaf, device: str) -> None:
    """The garbage collector, which knows nothing of a GPU's memory, has nothing to do with it."""
    scene = load_scene(small_scene)
    simulation = Simulation(scene, scene_leaf(scene), device)
    simulation.advance(2)
    arrays = [weakref.ref(simulation.state[name]) for name in simulation.state.names]
    gc.collect()
    gc.disable()
    try:
        del simulation
        assert [array for array in arrays if array() is not None] == []
    finally:
        gc.enable()
