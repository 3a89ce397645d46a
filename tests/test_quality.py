"""How finely a scene is computed: presets, a tolerance, and the keys of the solver that trade speed for accuracy."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from leafwarp.cli import main
from leafwarp.errors import InputError, SimulationError
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.scene.quality import DECIDED, HIGHEST_LEVEL, QUALITIES, Resolution
from leafwarp.sim.simulation import Simulation
from leafwarp.study import tolerance
from leafwarp.study.tolerance import at_level, choose_resolution, finer_error
from leafwarp.study.tradeoff.errors import errors_of
from leafwarp.study.tradeoff.trial import Trial, run_trial

# A level of the tests' own: small maps and meshes.
SMALL = {"cells": 10, "vertices": 40, "fluid_steps": 12}


def without_decided(scene_file: Path, **top) -> dict:
    data = load_scene(scene_file).model_dump(exclude_unset=True)
    for key in DECIDED:
        table, _, name = key.partition(".")
        data.get(table, {}).pop(name, None)
    return {**data, **top}


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


# Tolerance.


@pytest.fixture
def small_levels(monkeypatch):
    """Levels that are coarser than the product's."""

    def of(level: int) -> Resolution:
        finer = 2.0 ** (level / 2)
        return Resolution(
            round(SMALL["cells"] * finer), round(SMALL["vertices"] * finer**2), round(SMALL["fluid_steps"] * finer)
        )

    monkeypatch.setattr(Resolution, "of", staticmethod(of))


@pytest.fixture
def made_up(monkeypatch):
    """Films of first order whose error at level 0 is known; which levels were computed is noted."""

    def with_error(first: float) -> list[int]:
        computed: list[int] = []

        def run(scene, leaf, places, device) -> Trial:
            level = next(k for k in range(30) if Resolution.of(k).vertices == scene.mesh.vertices)
            computed.append(level)
            points = np.zeros((2, len(places), 3))
            points[:, :, 2] = first * leaf.length / 2.0 ** (level / 2)
            return Trial(points, np.ones((2, len(places))), 0, 1, 1, 0, 1, 1, 0, 0, 1)

        monkeypatch.setattr(tolerance, "run_trial", run)
        return computed

    return with_error


@pytest.mark.parametrize(
    ("first", "wanted", "levels"),
    [
        (0.001, 0.01, [0, 2]),  # the coarsest will do
        (0.02, 0.02, [0, 2]),
        (0.10, 0.02, [0, 2, 5]),  # too far ahead for the first two
        (0.10, 0.005, [0, 2, 4, 6]),
    ],
)
def test_films_grow_finer_until_the_next_is_near(
    small_scene: Path, scene_leaf, small_levels, made_up, leaf_cache, first: float, wanted: float, levels: list[int]
) -> None:
    computed = made_up(first)
    scene = Scene.checked(without_decided(small_scene, tolerance=wanted), "scene")
    choice = choose_resolution(scene, leaf_cache, "cpu")
    true_error = first / 2.0 ** (choice.level / 2)
    assert choice.expected == pytest.approx(true_error, rel=1e-6)
    assert true_error <= tolerance.AIM * wanted or choice.level == HIGHEST_LEVEL
    if choice.level > 0:  # and no finer than it must be
        assert true_error * 2.0**0.5 > tolerance.AIM * wanted
    assert computed[:2] == levels[:2] and computed == sorted(computed)
    assert choice.level <= computed[-1] + tolerance.FARTHEST
    assert choice.scene.mesh.vertices == Resolution.of(choice.level).vertices


def test_richardson() -> None:
    for levels in (1, 2, 3, 4):
        fine = 0.01
        coarse = fine * 2.0 ** (levels / 2)
        assert finer_error(coarse - fine, levels) == pytest.approx(fine)


def test_the_estimate_is_near_the_truth(small_scene: Path, scene_leaf, small_levels, leaf_cache: Path) -> None:
    """Against a film four levels finer, with a quarter of the error; more than a vertex is held at every level."""
    data = without_decided(small_scene, tolerance=0.05)
    data["time"]["frames"] = 13
    data["motion"]["pin_radius"] = 0.012
    data["curl"]["mismatch"] = [[1.0, 0.0], [0.2, 0.004]]
    scene = Scene.checked(data, "scene")
    choice = choose_resolution(scene, leaf_cache, "cpu")
    ours = run_trial(choice.scene, scene_leaf(choice.scene), choice.places, "cpu")
    finer = at_level(scene, choice.level + 4)
    truth = errors_of(ours, run_trial(finer, scene_leaf(finer), choice.places, "cpu"), 0.08).shape
    assert truth <= 0.05
    assert truth / 3.0 < choice.error_of(ours, 0.08) < 3.0 * truth


def test_a_run_with_a_tolerance_reports_what_it_reached(
    small_scene: Path, small_levels, prepared_folder: Path, capsys
) -> None:
    arguments = [
        "run",
        str(small_scene),
        "-o",
        str(prepared_folder),
        "--set",
        "tolerance=0.1",
        "--set",
        "fluid.step=900",
    ]
    assert main(arguments) == 0
    captured = capsys.readouterr()
    assert "coarse film of level 2" in captured.err and "tolerance: 10 %" in captured.err
    report = json.loads((prepared_folder / "small.report.json").read_text())
    found = report["tolerance"]
    assert found["asked"] == 0.1 and 0.0 < found["reached"] < 0.3 and found["pilot_levels"][:2] == [0, 2]
    # What the command line says itself stands.
    assert set(found["resolution"]) == {"mesh.vertices", "maps.size", "fluid.scheme"}
    assert report["fluid"]["step_seconds"] == 900.0
    assert report["seconds"]["tolerance"] > 0.0


def test_part_of_a_film_has_no_error_to_report(small_scene: Path, small_levels, prepared_folder: Path) -> None:
    arguments = ["run", str(small_scene), "-o", str(prepared_folder), "--set", "tolerance=0.2", "-f", "1:2", "-q"]
    assert main(arguments) == 0
    assert json.loads((prepared_folder / "small.report.json").read_text())["tolerance"]["reached"] is None


def test_a_coarse_film_that_fails_says_so(small_scene: Path, small_levels, leaf_cache: Path) -> None:
    scene = load_scene(small_scene, ["tolerance=0.1", "solver.maximum_substeps=1"])
    with pytest.raises(SimulationError, match=r"frame 2: coarse film for tolerance: motion: needs .* substeps"):
        choose_resolution(scene, leaf_cache, "cpu")


def test_without_a_tolerance_nothing_of_it_is_loaded(small_scene: Path, tmp_path: Path) -> None:
    import subprocess
    import sys

    code = (
        "import sys; from pathlib import Path; from leafwarp.scene.file import load_scene; "
        "from leafwarp.run import output_paths, run_scene; "
        f"scene = load_scene(Path({str(small_scene)!r})); "
        f"run_scene(scene, output_paths(scene, Path({str(tmp_path)!r})), frames=range(1, 2), progress_level=-1); "
        "print([name for name in sys.modules if name.startswith('leafwarp.study')])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_the_schema_knows_both(small_scene: Path) -> None:
    properties = Scene.model_json_schema()["properties"]
    assert set(properties["quality"]["anyOf"][0]["enum"]) == set(QUALITIES)
    assert properties["tolerance"]["anyOf"][0]["maximum"] == 0.5
