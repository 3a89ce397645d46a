"""The verb ``new``: the scene with what was found, the overlay, the maps; the same motion at any length."""

from __future__ import annotations

import os
import re
import shutil
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

from leafwarp.cli import main
from leafwarp.leaf.leaf import Leaf
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.scene.file import load_scene
from leafwarp.scene.material import MaterialTable
from leafwarp.scene.presets import PRESETS
from leafwarp.sim.simulation import Simulation
from test_cli import refused

FEW = {"mesh.vertices": 120, "maps.size": 32, "time.frames": 4, "output.contact_sheet": False}


@pytest.fixture(scope="module")
def folder(photo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the drawn photo, and the scene, overlay and maps that were made for it."""
    folder = tmp_path_factory.mktemp("new")
    shutil.copy(photo, folder / "drawn.png")
    assert main(["new", str(folder / "drawn.png"), "-o", str(folder / "mine.toml"), "--length", "7 cm", "--maps"]) == 0
    return folder


@pytest.fixture(scope="module")
def leaf(folder: Path, scene_leaf) -> Leaf:
    """The leaf of that scene."""
    return scene_leaf(load_scene(folder / "mine.toml"))


def test_scene_overlay_and_maps_are_written(folder: Path) -> None:
    maps = [f"mine.{name}.png" for name in ("venation", "stomata", "water", "source")]
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        ["drawn.png", "mine.toml", "mine.overlay.png", *maps]
    )
    overlay = cv2.imread(str(folder / "mine.overlay.png"))
    assert 400 < max(overlay.shape) <= 1600


def test_comments_say_what_was_found(folder: Path, leaf: Leaf) -> None:
    text = (folder / "mine.toml").read_text()
    assert "photo of 200 x 320 pixels; mine.overlay.png shows it" in text
    assert re.search(r"^#   confidence [01]\.\d\d of 1; veins", text, re.MULTILINE)
    assert re.search(r"^#   7 cm long, \d+(\.\d)? cm\^2", text, re.MULTILINE)
    base = [float(number) for number in re.search(r"^# base = \[(\d+), (\d+)\]", text, re.MULTILINE).groups()]
    np.testing.assert_allclose(base, leaf.findings.base, atol=0.5)
    np.testing.assert_allclose(base, (100.0, 302.0), atol=6.0)  # where conftest draws the petiole's end


def in_si_units(text: str, figures: bool = False) -> str:
    """The scene with its leaf in SI units in place of the soft one, on request with the material's figures."""
    before, _, soft = text.partition("# ---- A soft leaf")
    _, _, rest = soft.partition("# ---- each line of what follows.\n")
    block, _, after = rest.partition("# ---- The end of the leaf in SI units.\n")
    block = re.sub(r"^# ?", "", block, flags=re.MULTILINE)
    return before + (re.sub(r"^# ", "", block, flags=re.MULTILINE) if figures else block) + after


def uncommented(text: str) -> list[str]:
    """Every line of a scene that is a key in a comment of its table, without its sign."""
    before, _, rest = text.partition("# ---- ... to here.")
    text = before + rest.partition("# ---- The end of the leaf in SI units.")[2]
    return [line.removeprefix("# ") for line in text.splitlines() if re.match(r"# [a-z_]+ = ", line)]


def test_every_override_is_accepted_when_it_is_uncommented(folder: Path) -> None:
    text = (folder / "mine.toml").read_text()
    keys = uncommented(text)
    wanted = {"base", "rect", "mask", "holes", "venation", "texture_limit", "vertices", "size", "scheme", "step"}
    assert {line.split(" = ")[0] for line in keys} >= wanted
    for line in keys:
        changed = folder / "changed.toml"
        changed.write_text(text.replace(f"# {line}", line))
        key, value = next(iter(tomllib.loads(line).items()))
        scene = load_scene(changed)
        tables = [getattr(scene, table) for table in ("leaf", "mesh", "maps", "fluid", "motion", "output")]
        held = next(getattr(table, key) for table in tables if key in type(table).model_fields)
        assert held == (tuple(value) if isinstance(value, list) else folder / value if key == "mask" else held)
        changed.unlink()


@pytest.mark.parametrize("preset", PRESETS)
def test_the_leaf_in_si_units_runs_when_it_is_uncommented(folder: Path, scene_leaf, preset: str) -> None:
    changed = folder / "changed.toml"
    changed.write_text(in_si_units((folder / "mine.toml").read_text()))
    scene = load_scene(changed, [f"material.preset={preset}"])
    changed.unlink()
    assert scene.warnings == ()
    assert scene.material == MaterialTable(preset=preset)
    assert (scene.motion.method, scene.motion.settle) == ("quasistatic", True)
    assert scene.transpiration.closure == scene.material.turgor
    scene = scene.with_changes(FEW | {"time.duration": "48 h"})
    frames = list(Simulation(scene, scene_leaf(scene)).frames())
    assert frames[-1].water.mean() < 0.5 * frames[0].water.mean()
    assert np.isfinite(frames[-1].points).all()


def test_the_figures_offered_for_a_material_are_those_of_its_preset(folder: Path) -> None:
    tables = tomllib.loads(in_si_units((folder / "mine.toml").read_text(), figures=True))
    figures = tables["material"]
    assert len(figures) > 5
    assert MaterialTable(**figures).model_dump() == pytest.approx(MaterialTable(preset=figures["preset"]).model_dump())


@pytest.mark.parametrize("key", ["base", "rect"])
def test_the_offered_base_and_rect_find_the_same_leaf(folder: Path, leaf: Leaf, key: str) -> None:
    text = (folder / "mine.toml").read_text()
    (line,) = [line for line in uncommented(text) if line.startswith(key)]
    changed = folder / "changed.toml"
    changed.write_text(text.replace(f"# {line}", line))
    again = prepare_scene_leaf(load_scene(changed), None)
    changed.unlink()
    assert again.mesh.vertex_areas.sum() == pytest.approx(leaf.mesh.vertex_areas.sum(), rel=0.03)
    np.testing.assert_allclose(again.findings.base, leaf.findings.base, atol=0.03 * 260)  # of its length


def test_written_maps_give_the_same_maps(folder: Path, leaf: Leaf) -> None:
    scene = load_scene(folder / "mine.toml", [f"maps.{name}='mine.{name}.png'" for name in ("venation", "stomata")])
    again = prepare_scene_leaf(scene, None)
    # Veins that are drawn anew widen a stalk thinner than the cells, a given picture does not. The cells are half as
    # wide as the photo's pixels, which a picture cannot follow any better.
    widened = cv2.dilate((leaf.mask != again.mask).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert np.count_nonzero(leaf.mask & ~widened) > 0.98 * np.count_nonzero(leaf.mask)
    for name in ("venation", "stomata"):
        assert np.abs(again.maps[name] - leaf.maps[name])[~widened].max() < 8.0 / 255.0, name


def test_run_writes_maps_on_request(folder: Path, tmp_path: Path, capsys) -> None:
    changes = [part for key, value in FEW.items() for part in ("--set", f"{key}={str(value).lower()}")]
    arguments = ["run", str(folder / "mine.toml"), "-o", str(tmp_path), "-q", "--frames", "1:2", "--maps", *changes]
    assert main(arguments) == 0
    for name in ("venation", "stomata", "water", "source"):
        picture = cv2.imread(str(tmp_path / f"mine.{name}.png"), cv2.IMREAD_UNCHANGED)
        assert picture.ndim == 2 and picture.max() > 0
    capsys.readouterr()
    (tmp_path / "mine.usd").unlink()
    assert "exists already" in refused(capsys, *arguments)


def test_maps_of_a_run_never_replace_those_of_its_scene(folder: Path, capsys) -> None:
    given = ["--set", "maps.venation='mine.venation.png'", "--maps", "--overwrite"]
    before = (folder / "mine.venation.png").read_bytes()
    assert "is an image of the scene" in refused(capsys, "run", folder / "mine.toml", "-o", folder, *given)
    assert (folder / "mine.venation.png").read_bytes() == before


def final_shape(scene_file: Path) -> np.ndarray:
    """Points of the last frame over the leaf's length, shape [vertex_count, 3], with a mesh and maps kept small."""
    scene = load_scene(scene_file).with_changes(FEW | {"time.frames": 24})  # a second, in which it can curl
    leaf = prepare_scene_leaf(scene, None)
    return list(Simulation(scene, leaf).frames())[-1].points / leaf.length


def test_a_leaf_moves_alike_at_any_length(folder: Path, tmp_path: Path) -> None:
    shapes = []
    for length in ("2 cm", "25 cm"):
        scene = tmp_path / f"{length.replace(' ', '_')}.toml"
        assert main(["new", str(folder / "drawn.png"), "-o", str(scene), "--length", length]) == 0
        shapes.append(final_shape(scene))
    assert np.ptp(shapes[0][:, 2]) > 0.05  # it curls
    # Numbers are rounded to three digits, and the mesh to float32.
    assert np.abs(shapes[0] - shapes[1]).max() < 0.02


def test_existing_files_and_the_photo_itself_are_kept(folder: Path, tmp_path: Path, capsys) -> None:
    picture = tmp_path / "leaf.overlay.png"
    shutil.copy(folder / "drawn.png", picture)
    for more in ((), ("--overwrite",)):
        assert "is the photo itself" in refused(capsys, "new", picture, "-o", tmp_path / "leaf.toml", *more)
    shutil.copy(folder / "drawn.png", tmp_path / "other.png")
    (tmp_path / "other.water.png").write_text("mine")
    refusal = refused(capsys, "new", tmp_path / "other.png", "-o", tmp_path / "other.toml", "--maps")
    assert "other.water.png: exists already" in refusal
    assert sorted(path.name for path in tmp_path.iterdir()) == ["leaf.overlay.png", "other.png", "other.water.png"]
    assert "is a folder" in refused(capsys, "new", tmp_path)


def test_a_photo_without_a_leaf_leaves_nothing(tmp_path: Path, capsys) -> None:
    cv2.imwrite(str(tmp_path / "plain.png"), np.full((200, 300, 3), 180, np.uint8))
    assert "plain.png" in refused(capsys, "new", tmp_path / "plain.png", "-o", tmp_path / "plain.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["plain.png"]


@pytest.mark.parametrize("name", ['ünï 🍃 "leaf".png', "tab\there.png"])
def test_any_name_of_a_photo_can_be_written(folder: Path, tmp_path: Path, name: str) -> None:
    shutil.copy(folder / "drawn.png", tmp_path / name)
    assert main(["new", str(tmp_path / name), "-o", str(tmp_path / "leaf.toml")]) == 0
    assert load_scene(tmp_path / "leaf.toml").leaf.image == tmp_path / name


@pytest.mark.skipif(os.name == "nt", reason="a name is Unicode there")
def test_a_name_that_is_not_utf8_is_refused(folder: Path, tmp_path: Path, capsys) -> None:
    photo = tmp_path / os.fsdecode(b"leaf\xff.png")
    shutil.copy(folder / "drawn.png", photo)
    assert "not UTF-8" in refused(capsys, "new", photo, "-o", tmp_path / "leaf.toml")
