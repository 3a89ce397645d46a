"""Leaves of several photos in one scene."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdShade

from leafwarp.errors import InputError
from leafwarp.render.contact_sheet import stacked_textures
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.usd.check import check_usd
from many_leaves import changed


def test_a_scene_holds_leaves_of_several_photos(two_photos, small_scene, scene_leaf, device, tmp_path) -> None:
    from leafwarp.run import output_paths, run_scene

    scene = changed(two_photos, output__contact_sheet=True)
    assert scene.leaves.count == 2 and scene.photos[1].image.is_absolute()
    leaves = scene_leaf(scene)
    assert [photo.length for photo in leaves.photos] == pytest.approx([0.08, 0.04])
    assert leaves.join(lambda photo, specimen: np.array([specimen.camber])).tolist() == [0.01, 0.0]
    paths = output_paths(scene, tmp_path / "two.usd")
    report = run_scene(scene, paths, device=device, frames=range(1, 3), progress_level=-1)
    assert report["leaf"]["count"] == 2
    assert check_usd(paths.usd) == []
    stage = Usd.Stage.Open(str(paths.usd))
    for index, photo in enumerate(leaves.photos):
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath(f"/Leaves/leaf_{index + 1:04d}/leaf"))
        assert np.array(mesh.GetFaceVertexIndicesAttr().Get()).max() == photo.mesh.vertex_count - 1
        material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
        texture = UsdShade.Shader(stage.GetPrimAtPath(material.GetPath().AppendChild("texture")))
        number = ("", "_2")[index]
        assert texture.GetInput("file").Get().path == f"./two_texture{number}.png"
        assert (tmp_path / f"two_texture{number}.png").is_file()


def test_several_photos_share_the_leaves_in_turn(two_photos, scene_leaf) -> None:
    scene = changed(two_photos, leaves__count=5, leaves__size=0.1)
    leaves = scene_leaf(scene)
    assert leaves.photo_of == (0, 1, 0, 1, 0)
    counts = [photo.mesh.vertex_count for photo in leaves.photos]
    assert leaves.mesh.vertex_count == 3 * counts[0] + 2 * counts[1]


def test_textures_of_several_photos_are_one_picture_on_the_sheet(two_photos, scene_leaf) -> None:
    leaves = scene_leaf(changed(two_photos))
    uv, whole = stacked_textures(leaves)
    for photo, own in zip(leaves.photos, leaves.vertex_slices, strict=True):
        rows, columns = photo.texture.shape[:2]
        expected = photo.texture[((1 - photo.uv[:, 1]) * rows).astype(int), (photo.uv[:, 0] * columns).astype(int)]
        place = np.column_stack(((1 - uv[own, 1]) * whole.shape[0], uv[own, 0] * whole.shape[1])) + 1e-6
        found = whole[tuple(place.astype(int).T)]
        assert np.abs(found[:, :3].astype(int) - expected[:, :3]).max() <= 2


def test_an_image_of_a_map_is_of_one_photo(two_photos) -> None:
    with pytest.raises(InputError, match=r"maps\.venation: an image is accepted with one photo; here are 2"):
        changed(two_photos, maps__venation="drawn.png")


def test_a_key_set_of_several_photos_is_set_of_each(two_photos) -> None:
    scene = load_scene(two_photos, ["leaf.camber=0.03", "leaf.length=5 cm"])
    assert [(photo.camber, photo.length) for photo in scene.photos] == [(0.03, 0.05)] * 2
    with pytest.raises(InputError, match=r"leaf\.camber = 7\.0: accepted: 0 to 0\.5"):
        load_scene(two_photos, ["leaf.camber=7.0"])
    with pytest.raises(InputError, match=r"--set time\.frames\.first: 'frames' is a value, not a table"):
        load_scene(two_photos, ["time.frames.first=1"])


def test_the_schema_knows_several_photos(two_photos) -> None:
    schema = Scene.model_json_schema()
    one, many = schema["properties"]["leaf"]["anyOf"]
    assert many == {"type": "array", "items": one, "minItems": 1}
    assert one["$ref"] == "#/$defs/LeafTable"
