"""What cannot be is seen, named and not written: water, masses, springs, positions and velocities, in every motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

from fluid_sample import SCHEMES, ellipse, make_sample, stage_name
from leafwarp.cli import main
from leafwarp.errors import SimulationError
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.sim.guards import GUARDS, find_fault
from leafwarp.sim.simulation import Simulation

NOT_FINITE = (np.nan, np.inf)
SPOILT = 3  # the frame before which an array is spoilt


def run_spoilt(scene: Scene, leaf, device: str, array: str, spoil) -> tuple[SimulationError, list[int]]:
    """The error of a run of which ``spoil`` changes an array before a frame, and the frames that came before it."""
    simulation = Simulation(scene, leaf, device)
    frames = []
    with pytest.raises(SimulationError) as caught:
        for frame in simulation.frames():
            frames.append(frame.index)
            assert all(np.isfinite(values).all() for values in (frame.points, frame.velocities, frame.water))
            if frame.index == SPOILT - 1:
                values = simulation.state[array].numpy().copy()
                spoil(values)
                simulation.state.upload(array, values)
    return caught.value, frames


@pytest.mark.parametrize("value", [*NOT_FINITE, -0.1, 1.5])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_water_that_is_none_is_seen(scheme, value, precision, device, small_scene, scene_leaf) -> None:
    solver = {"unsplit": "factor", "iterated": "conjugate_gradients"}.get(scheme)
    changes = {"solver.precision": precision, "fluid.scheme": "unsplit" if solver else "split"}
    scene = load_scene(small_scene).with_changes(changes | ({"fluid.solver": solver} if solver else {}))
    leaf = scene_leaf(scene)

    def spoil(water: np.ndarray) -> None:
        # One bad cell among good ones would soon be as good as they are.
        cells = leaf.mask if np.isfinite(value) else tuple(np.argwhere(leaf.mask)[7])
        water[cells] = value

    error, frames = run_spoilt(scene, leaf, device, "water", spoil)
    assert frames == list(range(1, SPOILT))
    assert error.frame == SPOILT
    assert error.stage in ("water", stage_name(scheme))
    assert "the water of cell" in str(error) or "water of row" in str(error)
    assert "accepted: " in str(error) and "would help" in str(error)
    assert "\n" not in str(error)


@pytest.mark.parametrize("value", [*NOT_FINITE, -0.1, 1.5])
def test_a_single_cell_is_found(value, precision, device) -> None:
    sample = make_sample({"fluid": {"lamina_diffusivity": 0.0, "vein_diffusivity": 0.0}}, ellipse(40), device=device,
                         precision=precision)  # fmt: skip
    sample.fluid.advance(100.0, 2)
    sample.fluid.check(2)
    sample.set_water(np.where(np.arange(1600).reshape(40, 40) == 40 * 23 + 21, value, sample.water))
    sample.fluid.advance(160.0, 3)
    with pytest.raises(SimulationError, match="frame 3: water: the water of cell 21 of row 23 of the map is"):
        sample.fluid.check(3)


def test_a_bound_follows_from_start_and_supply(precision, device) -> None:
    mask = ellipse(16)
    tables = {
        "fluid": {"lamina_diffusivity": 0.0, "vein_diffusivity": 0.0},
        "source": {"conductance": 1e-4, "supply": 0.4},
    }
    maps = {"water": np.full(mask.shape, 0.3), "source": mask.astype(float)}
    for content, is_sound in ((0.39, True), (0.45, False)):
        sample = make_sample(tables, mask, maps, device=device, precision=precision)
        sample.set_water(np.where(mask, content, 0.0))
        sample.fluid.advance(60.0)
        if is_sound:
            sample.fluid.check(1)
        else:
            with pytest.raises(SimulationError, match=r"accepted: -\S+ to 0\.4"):
                sample.fluid.check(1)


@pytest.mark.parametrize("start", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("step", [1e-3, 1.0, 1e6])
def test_sound_water_is_never_refused(scheme, start, step, precision, device) -> None:
    """Bone dry and saturated leaves, fed and drained by far more than there is, at any step."""
    mask = ellipse(20)
    rng = np.random.default_rng(5)
    maps = {"water": np.full(mask.shape, start), "source": mask * (rng.random(mask.shape) < 0.1)}
    maps["venation"] = rng.random(mask.shape) ** 8
    tables = {
        "time": {"duration": 40.0 * step},
        "fluid": {"scheme": scheme, "step": step, "lamina_diffusivity": 1e-9, "vein_diffusivity": 1e-4},
        "transpiration": {"rate": 0.3 / step, "cuticle_rate": 0.3 / step},
        "source": {"conductance": 30.0 / step, "supply": 0.9, "cut_at": 15.0 * step, "rewatered_at": 30.0 * step},
    }
    sample = make_sample(tables, mask, maps, device=device, precision=precision)
    try:
        for look in range(1, 81):
            sample.fluid.advance(0.5 * look * step, look)
            sample.fluid.check(look)
    except SimulationError as error:
        # Where conjugate gradients say that they do not converge, the guard has nothing against the water.
        assert scheme == "iterated" and error.stage == "unsplit_diffusion" and "iterations" in str(error)


STRUCTURE = """
[leaf]
image = "drawn.png"
length = "8 cm"
[mesh]
vertices = 60
[time]
duration = "1 h"
frames = 5
[water]
curve = [["0 h", 1.0]]
[structure]
membrane_stiffness = 6.0
bending_stiffness = 1e-5
water_mass = 0.0
[motion]
gravity = [0.0, 0.0, -0.1]
[output]
contact_sheet = false
"""


@pytest.fixture(scope="module")
def plain_scene(photo: Path) -> Scene:
    """A scene in which nothing follows the water, so that what is spoilt stays so."""
    path = photo.with_name("structure.toml")
    path.write_text(STRUCTURE)
    return load_scene(path)


METHODS = {
    "explicit, float32": {"solver.precision": "float32"},
    "explicit, float64": {"solver.precision": "float64"},
    "explicit, paper": {"structure.bending": "paper"},
    "explicit, no bending": {"structure.bending_stiffness": 0.0},
    "implicit": {"motion.method": "implicit"},
    "quasistatic": {"motion.method": "quasistatic"},
}
SPOILT_ARRAYS = [
    *((guard.array, value) for guard in GUARDS for value in (np.nan, np.inf)),
    *((guard.array, -0.1) for guard in GUARDS if guard.lowest is not None),
]


@pytest.mark.filterwarnings("ignore:invalid value encountered in divide")  # of an infinite mass by the mean
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("array", "value"), SPOILT_ARRAYS)
def test_a_structure_that_cannot_be_is_seen(method, array, value, plain_scene, scene_leaf, device) -> None:
    scene = plain_scene.with_changes(METHODS[method])
    leaf = scene_leaf(scene)
    if "hinge" in array and not scene.has_angular_springs:
        assert array not in Simulation(scene, leaf, device).state
        return
    if method == "quasistatic" and array in ("velocity", "hinge_angle"):
        # The velocity follows from the shapes, which are told no velocity; this one stays as it is.
        simulation = Simulation(scene, leaf, device)
        for frame in simulation.frames():
            assert np.isfinite(frame.points).all() and np.isfinite(frame.velocities).all()
            simulation.state[array].fill_(value)
        return
    vertices = np.arange(leaf.mesh.vertex_count)[:, None]
    ends = {"edge": leaf.mesh.edges, "hinge": leaf.mesh.hinges, "vertex": vertices}
    guard = next(guard for guard in GUARDS if guard.array == array)
    far = np.linalg.norm(leaf.mesh.positions, axis=1)[ends[guard.element]].min(axis=1)
    index = int(np.argmax(far))  # far from what is pinned

    def spoil(values: np.ndarray) -> None:
        values[index] = value

    error, frames = run_spoilt(scene, leaf, device, array, spoil)
    assert frames == list(range(1, SPOILT))
    assert error.frame == SPOILT
    assert error.stage in ("motion", "implicit_motion", "quasistatic_motion", "frame")
    assert f"the {guard.quantity} of {guard.element} {index} is" in str(error), str(error)
    assert guard.unit in str(error) and "accepted: a finite number" in str(error) and guard.remedy in str(error)


def test_a_sound_structure_has_no_fault(small_scene, scene_leaf, device) -> None:
    scene = load_scene(small_scene)
    simulation = Simulation(scene, scene_leaf(scene), device)
    assert find_fault(simulation.state) is None
    for _ in simulation.frames():
        assert find_fault(simulation.state) is None


def test_the_frames_before_a_fault_are_kept(small_scene, prepared_folder, monkeypatch, capsys) -> None:
    advance = Simulation.advance

    def spoilt(simulation: Simulation, frame: int) -> None:
        if frame == 5:
            simulation.state["water"].fill_(np.nan)
        advance(simulation, frame)

    monkeypatch.setattr(Simulation, "advance", spoilt)
    assert main(["run", str(small_scene), "-q", "-o", str(prepared_folder)]) == 1
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "warning" not in line]
    assert "frame 5: water: the water of cell" in line
    stage = Usd.Stage.Open(str(prepared_folder / "small.usd"))
    points = stage.GetPrimAtPath("/Leaf/geo").GetChildren()[0].GetAttribute("points")
    assert points.GetTimeSamples() == [1.0, 2.0, 3.0, 4.0]
    assert all(np.isfinite(points.Get(time)).all() for time in points.GetTimeSamples())


def test_the_benchmark_measures_a_frame_with_and_without_the_checks(
    small_scene, scene_leaf, monkeypatch, capsys
) -> None:
    from benchmarks import guards
    from benchmarks.__main__ import main as benchmark

    monkeypatch.setattr(guards, "prepare_scene_leaf", lambda scene, cache: scene_leaf(scene))
    monkeypatch.setattr(guards, "SCENE", small_scene)
    assert benchmark(["guards", "--quick"]) == 0
    assert "| 64^2 |" in capsys.readouterr().out
    scene = load_scene(small_scene)
    for is_guarded in (True, False):
        if is_guarded:
            simulation = Simulation(scene, scene_leaf(scene), "cpu")
        else:
            with guards.without_guards():
                simulation = Simulation(scene, scene_leaf(scene), "cpu")
        water, stable_step = simulation.stage("water"), simulation.stage("stable_step")
        simulation.state["water"].fill_(np.nan)
        water.blend(1.0)
        assert (water.last_signs()[0] == water.looks) == is_guarded
        simulation.state["edge_rest_length"].fill_(-1.0)
        assert np.isnan(stable_step.largest_stretch()) == is_guarded
