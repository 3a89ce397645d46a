"""How finely a scene is computed: presets, and the keys of the solver that trade speed for accuracy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from leafwarp.errors import InputError
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.scene.quality import HIGHEST_LEVEL, QUALITIES, Resolution
from leafwarp.sim.simulation import Simulation
from scene_strategies import without_decided

# Quality.


@pytest.mark.parametrize("quality", list(QUALITIES))
def test_a_quality_decides_what_the_scene_leaves_out(small_scene: Path, quality: str) -> None:
    scene = Scene.checked(without_decided(small_scene, quality=quality), "scene")
    wanted = Resolution.of(QUALITIES[quality])
    assert scene.mesh.vertices == wanted.vertices and scene.maps.shape == (wanted.cells, wanted.cells)
    assert scene.fluid.step == scene.time.duration / wanted.fluid_steps
    assert (scene.fluid.scheme, scene.fluid.solver) == ("unsplit", "conjugate_gradients")


def test_what_the_scene_says_itself_stands(small_scene: Path) -> None:
    own = load_scene(small_scene)
    data = own.model_dump(exclude_unset=True) | {"quality": "final"}
    scene = Scene.checked(data, "scene")
    assert (scene.mesh, scene.maps, scene.fluid.step) == (own.mesh, own.maps, own.fluid.step)
    assert scene.fluid.scheme == "unsplit"


def test_on_the_command_line_a_quality_stands_over_the_file(small_scene: Path) -> None:
    scene = load_scene(small_scene, ["quality=draft", "mesh.vertices=90"])
    assert scene.mesh.vertices == 90 and scene.maps.shape[0] == Resolution.of(QUALITIES["draft"]).cells
    assert load_scene(small_scene, ["tolerance='5 %'"]).tolerance == 0.05


def test_finer_levels_halve_cells_edges_and_steps() -> None:
    for level in range(HIGHEST_LEVEL - 1):
        coarse, fine = Resolution.of(level), Resolution.of(level + 2)
        assert fine.cells == pytest.approx(2 * coarse.cells, abs=1)
        assert fine.fluid_steps == pytest.approx(2 * coarse.fluid_steps, abs=1)
        assert fine.vertices == pytest.approx(4 * coarse.vertices, abs=2)
    assert QUALITIES["draft"] < QUALITIES["balanced"] < QUALITIES["final"] <= HIGHEST_LEVEL


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["quality=nice"], "quality = 'nice': accepted: 'draft', 'balanced' or 'final'"),
        (["tolerance=0"], "tolerance = 0: accepted: 0.0001 to 0.5"),
        (["quality=draft", "tolerance=0.1"], "accepted: one of the two"),
        (["quality=draft", "leaves.count=2"], "quality: accepted without [leaves]"),
        (["tolerance=0.1", "leaves.count=2"], "tolerance: accepted without [leaves]"),
        (["solver.substep=0"], "solver.substep = 0: accepted: above 0, to 1"),
        (["solver.force_tolerance=2"], "solver.force_tolerance = 2: accepted: 1e-8 to 1"),
        (["solver.coupling_interval=0"], "solver.coupling_interval = 0: accepted: above 0, to 1e12 s"),
        (["solver.coupling_interval=1e-9"], "accepted: at most 1e+07, an interval of 0.00288 s or more"),
    ],
)
def test_bad_values_are_refused(small_scene: Path, changes: list[str], said: str) -> None:
    with pytest.raises(InputError) as refused:
        load_scene(small_scene, changes)
    assert said in str(refused.value)


# The solver's keys.


@pytest.fixture(scope="module")
def film(small_scene: Path, scene_leaf):
    """The simulation of the small scene with changes, after its last frame, and all of its frames."""

    def compute(*changes: str):
        scene = load_scene(small_scene, changes)
        simulation = Simulation(scene, scene_leaf(scene))
        return simulation, list(simulation.frames())

    return compute


def test_couplings_come_at_their_interval_and_frames_in_between_wait(film) -> None:
    """Nine frames over eight hours: an interval of two hours couples at every second frame."""
    simulation, frames = film("solver.coupling_interval='2 h'", "motion.gravity=[0, 0, 0]")
    every, all_frames = film("motion.gravity=[0, 0, 0]")
    for index, frame in enumerate(frames):
        coupled = index % 2 == 0
        # A frame in between shows the water of the last one before it.
        assert np.array_equal(frame.water, all_frames[index if coupled else index - 1].water)
    assert simulation.fluid.steps_done == every.fluid.steps_done == 48
    moments = [moment for frame in range(2, 10) for moment in simulation.moments(frame)]
    assert sum(len(moment.looks) for moment in moments) == 4
    assert sum(moment.share for moment in moments) == 8.0


def test_couplings_may_come_several_times_a_frame(film) -> None:
    simulation, frames = film("solver.coupling_interval='17 min'")
    moments = [moment for frame in range(2, 10) for moment in simulation.moments(frame)]
    # 8 h over 17 min is 28.2: 29 of them; the ends of frames that are none of theirs only let the leaf move on.
    assert sum(len(moment.looks) for moment in moments) == 29
    assert sum(moment.share for moment in moments) == pytest.approx(8.0)
    assert moments[-1].looks and moments[-1].looks[-1].end == simulation.scene.time.duration
    assert all(np.isfinite(frame.points).all() for frame in frames)


def test_an_interval_of_a_frame_changes_nothing(film) -> None:
    """Where explicit motion would not couple more often by itself."""
    slow = ("shrink.curve=[[1.0, 0.0], [0.2, 0.01]]", "time.frames=9")
    simulation, frames = film(*slow)
    assert simulation.couplings_per_frame == 1
    _, others = film(*slow, "solver.coupling_interval='1 h'")
    assert all(a.points.tobytes() == b.points.tobytes() for a, b in zip(frames, others, strict=True))


def test_a_shorter_substep_takes_more_of_them(film) -> None:
    whole, frames = film()
    half, finer = film("solver.substep=0.45")
    assert sum(half.substeps) == pytest.approx(2 * sum(whole.substeps), rel=0.02)
    assert np.abs(finer[-1].points - frames[-1].points).max() < 5e-3 * 0.08


@pytest.mark.parametrize("method", ["implicit", "quasistatic"])
def test_a_wider_force_tolerance_leaves_more_force_and_takes_less_work(film, method: str) -> None:
    effort, points = {}, {}
    for force in ("1e-6", "1e-3", "1e-1"):
        simulation, frames = film(f"motion.method={method!r}", f"solver.force_tolerance={force}", "time.frames=5")
        effort[force], points[force] = simulation.motion.newton.effort.iterations, frames[-1].points
    assert effort["1e-1"] < effort["1e-3"] < effort["1e-6"]
    near = np.abs(points["1e-3"] - points["1e-6"]).max()
    assert near < np.abs(points["1e-1"] - points["1e-6"]).max() and near < 1e-3 * 0.08


def test_the_schema_knows_both(small_scene: Path) -> None:
    properties = Scene.model_json_schema()["properties"]
    assert set(properties["quality"]["anyOf"][0]["enum"]) == set(QUALITIES)
    assert properties["tolerance"]["anyOf"][0]["maximum"] == 0.5


@pytest.mark.parametrize("curl", [{}, {"curl": {"plastic_set": 0.2}}], ids=["no curl", "a curl of the material"])
def test_a_quality_decides_maps_that_only_the_material_asks_for(curl: dict) -> None:
    """Of prescribed water no map is needed but for the veins, which a material makes stiffer."""
    data = {
        "quality": "draft",
        "leaf": {"image": "leaf.png", "length": 0.1},
        "time": {"duration": 3600.0},
        "water": {"curve": [[0.0, 1.0], [3600.0, 0.3]]},
        "material": {"preset": "tree"},
    }
    scene = Scene.checked(data | curl, "scene.toml")
    assert scene.map_names and scene.maps.shape == (96, 96) and scene.mesh.vertices == Resolution.of(0).vertices
    assert scene.curl.mismatch is not None
