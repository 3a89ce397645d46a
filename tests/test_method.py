"""How the leaf moves where a quality or a tolerance leaves that open."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from conftest import SCENES
from leafwarp.cli import main
from leafwarp.run import output_paths, run_scene
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.scene.quality import QUALITIES
from leafwarp.sim.method import MOST_SUBSTEPS, expected_substeps, fitting_method, with_fitting_method
from leafwarp.sim.simulation import Simulation
from leafwarp.study.tolerance import Search
from leafwarp.study.tradeoff.setting import Setting, preset_settings
from scene_strategies import without_decided

# Bounds of the estimate over what a mesh asks for: a mesh is drawn from a photo, with triangles that are not all
# regular, and few of its vertices lie on veins.
WITHIN = 2.0
STIFF = "structure.bending_stiffness=1e-3"


def of_quality(scene_file: Path, quality: str = "draft", *changes: str) -> Scene:
    return load_scene(scene_file, [f"quality={quality}", *changes])


@pytest.mark.parametrize(
    ("name", "quality"),
    [("bramble", "draft"), ("cut", "balanced"), ("blade", "draft"), ("blade", "balanced"), ("still", "balanced")],
)  # fmt: skip
def test_the_substeps_expected_are_about_those_required(name: str, quality: str, scene_leaf) -> None:
    scene = of_quality(SCENES / f"{name}.toml", quality, "motion.method=explicit")
    leaf = scene_leaf(scene)
    required = Simulation(scene, leaf).motion.required_substeps(1.0 / scene.time.fps)
    assert required / WITHIN < expected_substeps(scene, leaf, scene.mesh.vertices) < required * WITHIN


def test_the_substeps_expected_are_those_of_a_mesh_of_stretched_springs_or_bent_hinges(small_scene, scene_leaf) -> None:
    """Four times the vertices have edges of half the length: twice as many substeps for membranes, four times for
    hinges."""
    scene = of_quality(small_scene, "draft", "structure.damping=0", "motion.drag=0")
    leaf = scene_leaf(scene)

    def growth(**structure) -> float:
        changed = scene.with_changes({f"structure.{key}": value for key, value in structure.items()})
        return expected_substeps(changed, leaf, 4 * 160) / expected_substeps(changed, leaf, 160)

    assert growth(bending_stiffness=1e-30) == pytest.approx(2.0, rel=1e-6)
    assert growth(bending_stiffness=1.0, membrane_stiffness=0.0) == pytest.approx(4.0, rel=1e-6)
    stiffer = scene.with_changes({"structure.membrane_stiffness": 24.0, "structure.bending_stiffness": 4e-5})
    assert expected_substeps(stiffer, leaf, 160) == pytest.approx(2.0 * expected_substeps(scene, leaf, 160))


def test_without_stiffness_nothing_limits_the_step(small_scene, scene_leaf) -> None:
    soft = of_quality(small_scene, "draft", "structure.membrane_stiffness=0", "structure.bending_stiffness=1e-30")
    soft = soft.with_changes({"structure.bending_stiffness": 0.0, "curl": None})
    assert expected_substeps(soft, scene_leaf(soft), 160) < 1.0


def test_what_takes_many_substeps_moves_implicitly(small_scene, scene_leaf) -> None:
    soft, stiff = of_quality(small_scene), of_quality(small_scene, "draft", STIFF)
    leaf = scene_leaf(soft)
    assert expected_substeps(soft, leaf, 160) < MOST_SUBSTEPS < expected_substeps(stiff, leaf, 160)
    assert with_fitting_method(soft, leaf).motion.method == "explicit"
    chosen = with_fitting_method(stiff, leaf)
    assert (chosen.motion.method, chosen.solver.precision) == ("implicit", "float64")
    # Once decided, for good.
    assert not chosen.method_is_open and with_fitting_method(chosen, leaf) is chosen


@pytest.mark.parametrize(
    "says",
    ["motion.method=explicit", "motion.method=quasistatic", "solver.precision=float32", "solver.substep=0.5",
     "solver.maximum_substeps=100000", "structure.bending=paper", "motion.wind=[1.0, 0.0, 0.0]"],
)  # fmt: skip
def test_what_the_scene_says_of_its_motion_stands(says: str, small_scene, scene_leaf) -> None:
    scene = of_quality(small_scene, "draft", STIFF, says)
    assert not scene.method_is_open and with_fitting_method(scene, scene_leaf(scene)) is scene


def test_without_a_quality_motion_is_explicit(small_scene, scene_leaf) -> None:
    scene = load_scene(small_scene, [STIFF])
    assert not scene.method_is_open and with_fitting_method(scene, scene_leaf(scene)).motion.method == "explicit"


def test_a_material_is_quasistatic_with_a_quality_too(small_scene) -> None:
    data = without_decided(small_scene, quality="draft", material={"preset": "herb"})
    for table in ("structure", "shrink", "curl"):
        del data[table]
    scene = Scene.checked(data, "scene")
    assert scene.motion.method == "quasistatic" and not scene.method_is_open


def test_a_run_moves_so_and_tells(small_scene, prepared_folder: Path, capfd) -> None:
    scene = of_quality(small_scene, "draft", STIFF)
    report = run_scene(scene, output_paths(scene, prepared_folder / "stiff.usda"))
    assert report["motion"]["method"] == "implicit" and report["substeps"]["most"] == 1
    assert "motion.method = 'implicit'" in capfd.readouterr().err
    soft = of_quality(small_scene)
    report = run_scene(soft, output_paths(soft, prepared_folder / "soft.usda"))
    assert report["motion"]["method"] == "explicit" and "motion.method" not in capfd.readouterr().err


def test_both_motions_end_in_the_same_shape(small_scene, scene_leaf) -> None:
    """Within what more frames may change of it, in a film of four seconds; the shorter it is, the more the leaf swings
    at its end, which the two damp each in its own way."""
    last = []
    for method in ("explicit", "implicit"):
        changes = ("structure.bending_stiffness=1e-4", f"motion.method={method}", "time.frames=97")
        scene = of_quality(small_scene, "draft", *changes)
        *_, frame = Simulation(scene, scene_leaf(scene)).frames()
        last.append(frame.points)
    distance = np.sqrt(np.square(last[0] - last[1]).sum(axis=1).mean())
    assert distance < 5e-3 * 0.08


def test_the_plan_tells(small_scene, capsys) -> None:
    stiff = ["plan", str(small_scene), "--set", "quality=draft", "--set", STIFF]
    assert main([*stiff, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["motion"], report["motion_chosen"], report["precision"]) == ("implicit", True, "float64")
    assert main(stiff) == 0
    shown = capsys.readouterr()
    assert "motion.method = 'implicit': what takes the least time" in shown.out
    # Of substeps that are not taken nobody is warned.
    assert "substeps" not in shown.err and "a frame" not in shown.err
    assert main(["plan", str(small_scene), "--json"]) == 0
    assert not json.loads(capsys.readouterr().out)["motion_chosen"]


def test_all_films_of_a_tolerance_move_alike(small_scene, leaf_cache: Path) -> None:
    scene = Scene.checked(without_decided(small_scene, tolerance=0.05), "scene")
    for stiffness, method in ((1e-7, "explicit"), (1e-4, "implicit")):
        asked = scene.with_changes({"structure.membrane_stiffness": 0.5, "structure.bending_stiffness": stiffness})
        assert asked.method_is_open
        told: list[str] = []
        assert Search(asked, leaf_cache, "cpu", told.append).scene.motion.method == method
        assert [line.partition(":")[0] for line in told] == ["motion.method = 'implicit'"] * (method == "implicit")


def test_a_study_compares_the_presets_as_they_move(small_scene, scene_leaf) -> None:
    scene = load_scene(small_scene, ["structure.bending_stiffness=2e-5"])
    leaf = scene_leaf(scene)
    presets = preset_settings(scene, leaf)
    assert list(presets) == list(QUALITIES)
    for name, preset in presets.items():
        asked = of_quality(small_scene, name, "structure.bending_stiffness=2e-5")
        assert Setting.of(with_fitting_method(asked, leaf)) == preset
    assert {preset.motion for preset in presets.values()} == {"explicit", "implicit"}
    assert fitting_method(load_scene(small_scene, ["solver.substep=0.5"]), leaf, 10**6) == "explicit"
