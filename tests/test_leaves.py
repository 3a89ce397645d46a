"""Many leaves in one scene: each is as if it were alone, in the launches of one."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import Kind, Usd, UsdGeom, UsdShade
from scipy.spatial import cKDTree

from leafwarp.cli import main
from leafwarp.errors import InputError
from leafwarp.leaf.arrange import arrange_leaves, axis_angle, grid_cell, least_spacing
from leafwarp.leaf.leaves import Leaves, gather_leaves
from leafwarp.render.contact_sheet import ContactSheet, stacked_textures
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.scene.leaf import LeafTable
from leafwarp.scene.leaves import LeavesTable
from leafwarp.sim.simulation import Simulation
from leafwarp.usd.check import check_usd

# Alike leaves have other neighbours in a block of lanes and in a line, which changes nothing that they compute: their
# values are the same to the last bit. A leaf of another size shares them with none, and its water's exchange is divided
# by the square of a size that is no power of 2.
ROUNDING = {"float32": 2e-5, "float64": 1e-12}
VARIED = {"size": 0.3, "stiffness": 0.3, "water": 0.2, "turn": 180.0, "tilt": 30.0, "roll": 30.0}
FRAMES = 3


def changed(path: Path, **changes) -> Scene:
    plain = {"output.contact_sheet": False, "maps.size": 32}
    return load_scene(path).with_changes(plain | {key.replace("__", "."): value for key, value in changes.items()})


def computed(scene: Scene, leaf, device: str) -> tuple[Simulation, list]:
    simulation = Simulation(scene, leaf, device)
    return simulation, list(simulation.frames(FRAMES))


@pytest.mark.parametrize("scheme", ["split", "unsplit"])
def test_alike_leaves_move_as_one_alone(small_scene, scene_leaf, device, precision, scheme) -> None:
    alone = changed(small_scene, solver__precision=precision, fluid__scheme=scheme, fluid__solver="factor")
    many = alone.with_changes({"leaves.count": 5, "leaves.camber": False})
    leaf, leaves = scene_leaf(alone), scene_leaf(many)
    one, frames = computed(alone, leaf, device)
    all_of_them, frames_of_all = computed(many, leaves, device)
    assert all_of_them.substeps == one.substeps
    assert np.ptp(frames[-1].points - frames[0].points) > 1e-4  # it moves [m]
    for own in leaves.vertex_slices:
        for frame, frame_of_all in zip(frames, frames_of_all, strict=True):
            for name in ("points", "velocities", "normals", "water"):
                expected, found = getattr(frame, name), getattr(frame_of_all, name)[own]
                if scheme == "split":
                    assert np.array_equal(found, expected), name
                else:  # the factor of more cells is made in another order
                    assert found == pytest.approx(expected, abs=ROUNDING["float32"])


@pytest.mark.parametrize("scene", ["small_scene", "two_photos"])
def test_leaves_move_alike_group_by_group_and_all_at_once(scene, request, scene_leaf, device, monkeypatch) -> None:
    scene = changed(request.getfixturevalue(scene), leaves=VARIED | {"count": 70}, mesh__vertices=60, time__frames=3)
    leaves = scene_leaf(scene)
    groups = leaves.vertex_groups
    photos = len(leaves.photos)
    assert [own.stop for own in groups] == [
        *(leaves.vertex_slices[count - 1].stop for count in range(32 * photos, 70, 32 * photos)),
        leaves.mesh.vertex_count,
    ]
    grouped, frames = computed(scene, leaves, device)
    monkeypatch.setattr(Leaves, "vertex_groups", (slice(0, leaves.mesh.vertex_count),))
    at_once, frames_at_once = computed(scene, leaves, device)
    if not grouped.state.many_threads:
        assert len(grouped.stage("integration").parts) == len(groups) > 1
        assert len(at_once.stage("integration").parts) == 1
    assert np.ptp(frames[-1].points - frames[0].points) > 1e-4  # they move [m]
    for one, other in zip(frames, frames_at_once, strict=True):
        assert one.points.tobytes() == other.points.tobytes()


def test_varied_leaves_do_not_feel_each_other(small_scene, scene_leaf, device, precision) -> None:
    """A leaf moves alike among three others and beside that one alone which sets the damping and the substeps."""
    scene = changed(small_scene, solver__precision=precision, leaves=VARIED | {"count": 4, "seed": 3})
    leaves = scene_leaf(scene)
    simulation, frames = computed(scene, leaves, device)
    alone = [Simulation(scene, gather_leaves(leaves.photos, [0], [s]), device) for s in leaves.specimens]
    needed = [one.motion.required_substeps(1.0) for one in alone]
    fastest = int(np.argmax(needed))
    assert len(set(needed)) > 1
    for index, own in enumerate(leaves.vertex_slices):
        pair = gather_leaves(leaves.photos, [0, 0], [leaves.specimens[k] for k in (index, fastest)])
        of_pair, frames_of_pair = computed(scene, pair, device)
        assert of_pair.substeps == simulation.substeps
        for frame, frame_of_pair in zip(frames, frames_of_pair, strict=True):
            for name in ("points", "velocities", "normals", "water"):
                found = getattr(frame_of_pair, name)[pair.vertex_slices[0]]
                assert np.array_equal(found, getattr(frame, name)[own]), name


def test_leaves_differ_by_their_own_seed(small_scene, scene_leaf) -> None:
    few = scene_leaf(changed(small_scene, leaves=VARIED | {"count": 3})).specimens
    many = scene_leaf(changed(small_scene, leaves=VARIED | {"count": 40})).specimens
    other = scene_leaf(changed(small_scene, leaves=VARIED | {"count": 3, "seed": 1})).specimens
    assert [drawn(s) for s in many[:3]] == [drawn(s) for s in few]
    assert all(drawn(a) != drawn(b) for a, b in zip(few, other, strict=True))
    assert len({drawn(s) for s in many}) == 40
    sizes, stiffness, water = (np.array([getattr(s, n) for s in many]) for n in ("size", "stiffness", "water"))
    for values in (sizes, stiffness):
        assert 0.7 <= values.min() < 0.8 and 1.2 < values.max() <= 1.3
    assert 0.8 <= water.min() < 0.85 and 0.95 < water.max() <= 1.0


def specimens_of(table: LeavesTable, leaf):
    """The leaves of one photo."""
    return arrange_leaves(table, [leaf], [LeafTable(image="leaf.png", length=0.1)]).specimens


def drawn(specimen) -> tuple:
    return (
        *(specimen.size, specimen.stiffness, specimen.water, specimen.seed, specimen.place),
        *specimen.rotation.ravel().tolist(),
    )


def test_one_amount_leaves_the_others_as_they_are(small_scene, scene_leaf) -> None:
    """Where the spacing is given: the usual one keeps leaves of any draw apart."""
    leaf = scene_leaf(changed(small_scene))
    varied = specimens_of(LeavesTable(**VARIED, count=6, spacing=0.1), leaf)
    for name in VARIED:
        without = specimens_of(LeavesTable(**(VARIED | {name: 0.0}), count=6, spacing=0.1), leaf)
        kept = [field for field in ("size", "stiffness", "water", "seed", "place") if field != name]
        assert [[getattr(s, k) for k in kept] for s in without] == [[getattr(s, k) for k in kept] for s in varied]


def test_a_leaf_turns_about_its_base_and_tilts_its_tip(small_scene, scene_leaf) -> None:
    leaf = scene_leaf(changed(small_scene))
    axis = np.array([np.cos(axis_angle(leaf)), np.sin(axis_angle(leaf)), 0.0])
    for specimen in specimens_of(LeavesTable(count=30, tilt=40.0), leaf):
        tip = specimen.rotation @ axis
        assert np.cross(tip, axis)[2] == pytest.approx(0.0, abs=1e-12)  # over the same line on the ground
        assert abs(np.degrees(np.arcsin(tip[2]))) <= 40.0
        assert np.linalg.det(specimen.rotation) == pytest.approx(1.0)
    for specimen in specimens_of(LeavesTable(count=30, roll=40.0), leaf):
        assert specimen.rotation @ axis == pytest.approx(axis)
    for specimen in specimens_of(LeavesTable(count=30, turn=40.0), leaf):
        assert specimen.rotation[2] == pytest.approx([0.0, 0.0, 1.0])
    stem = specimens_of(LeavesTable(count=3, arrangement="stem", spacing=0.01), leaf)
    headings = [np.degrees(np.arctan2(*(s.rotation @ axis)[1::-1])) % 360.0 for s in stem]
    assert headings == pytest.approx([0.0, 137.508, 275.016], abs=1e-3)
    assert [s.place for s in stem] == [(0.0, 0.0, 0.0), (0.0, 0.0, 0.01), (0.0, 0.0, 0.02)]


def test_the_grid_is_square_and_keeps_its_places() -> None:
    for side in (1, 2, 7):
        cells = [grid_cell(index) for index in range(side * side)]
        assert sorted(cells) == [(column, row) for column in range(side) for row in range(side)]


@pytest.mark.parametrize(
    "amounts",
    [
        {},
        {"turn": 180.0},
        {"turn": 60.0, "size": 0.9},
        {"turn": 180.0, "size": 0.5, "tilt": 30.0, "roll": 180.0},
        {"tilt": 180.0},
        {"tilt": 180.0, "size": 0.9},
    ],
    ids=["alike", "any-direction", "sizes", "rolled", "tipped-over", "tipped-over-sizes"],
)
def test_leaves_of_a_grid_do_not_touch(amounts: dict, two_photos, scene_leaf) -> None:
    """Seen from above, with a free strip between any two."""
    photos = scene_leaf(changed(two_photos)).photos
    tables = [LeafTable(image="leaf.png", length=0.1)] * 2
    length = max(photo.length for photo in photos)
    for some in (photos[:1], photos):
        table = LeavesTable(**amounts, count=400)
        leaves = arrange_leaves(table, some, tables)
        seen = [
            (specimen.size * np.pad(some[index].mesh.positions, ((0, 0), (0, 1)))) @ turned(specimen).T + specimen.place
            for index, specimen in zip(leaves.photo_of, leaves.specimens, strict=True)
        ]
        points = np.concatenate(seen)[:, :2]
        owner = np.repeat(np.arange(len(seen)), [len(one) for one in seen])
        close = cKDTree(points).query_pairs(0.05 * length, output_type="ndarray")
        assert len(close) > 0 and np.array_equal(owner[close[:, 0]], owner[close[:, 1]])


def turned(specimen) -> np.ndarray:
    return np.eye(3) if specimen.rotation is None else specimen.rotation


def test_alike_leaves_lie_close_and_turned_ones_as_close_as_two_lengths_allow(small_scene, scene_leaf) -> None:
    leaf = scene_leaf(changed(small_scene))
    reach = np.linalg.norm(leaf.mesh.positions, axis=1).max()
    assert least_spacing(LeavesTable(count=2), [leaf]) < 1.3 * reach
    assert 2.0 * reach <= least_spacing(LeavesTable(count=2, turn=180.0), [leaf]) < 2.3 * reach
    assert least_spacing(LeavesTable(count=2, turn=180.0, size=0.5), [leaf]) == pytest.approx(
        1.5 * least_spacing(LeavesTable(count=2, turn=180.0), [leaf])
    )


def test_no_water_passes_from_leaf_to_leaf(small_scene, scene_leaf, device, precision) -> None:
    """A dry leaf beside wet ones stays dry, and the account of all of them closes."""
    scene = changed(small_scene, solver__precision=precision, leaves__count=6)
    scene = scene.with_changes(
        {"source": None, "transpiration": None, "stomata": None, "air": None, "leaves.water": 1.0}
    )
    leaves = scene_leaf(scene)
    simulation = Simulation(scene, leaves, device)
    tiles = [leaf_cells(leaves, index) for index in range(6)]
    before = [content(simulation, tile) for tile in tiles]
    simulation.fluid.advance(scene.time.duration)
    after = [content(simulation, tile) for tile in tiles]
    assert np.ptp(before) > 0.3
    assert after == pytest.approx(before, abs=ROUNDING[precision])
    assert simulation.fluid.ledger().start == pytest.approx(np.mean(before), rel=1e-6)


def leaf_cells(leaves, index: int) -> tuple[slice, slice]:
    (row, column), (rows, columns) = leaves.specimens[index].corner, leaves.photos[0].mask.shape
    return slice(row, row + rows), slice(column, column + columns)


def content(simulation: Simulation, tile: tuple[slice, slice]) -> float:
    mask = simulation.leaf.mask[tile]
    return float(simulation.state["water"].numpy()[tile][mask].mean(dtype=np.float64))


def test_the_ledger_of_all_leaves_closes(small_scene, scene_leaf, device, precision) -> None:
    scene = changed(small_scene, solver__precision=precision, leaves=VARIED | {"count": 7})
    simulation, _ = computed(scene, scene_leaf(scene), device)
    ledger = simulation.fluid.ledger()
    assert ledger.added > 1e-3 and ledger.transpired > 0.1
    assert abs(ledger.error) < {"float32": 2e-6, "float64": 1e-13}[precision]


def test_larger_leaves_are_slower_in_proportion_to_their_area(small_scene, scene_leaf) -> None:
    from leafwarp.sim.fluid.conductance import leaf_conductance

    scene = changed(small_scene)
    leaf = scene_leaf(scene)
    leaves = gather_leaves([leaf], [0, 0], [dataclasses.replace(leaf.specimens[0], size=size) for size in (1.0, 3.0)])
    alone, both = leaf_conductance(scene, leaf, 1.0), leaf_conductance(scene, leaves, 1.0)
    assert np.array_equal(both.x[leaf_cells(leaves, 0)], alone.x)
    assert both.y[leaf_cells(leaves, 1)] == pytest.approx(alone.y / 9.0)
    mesh = leaves.mesh
    half = leaf.mesh.vertex_count
    assert mesh.vertex_areas[half:] == pytest.approx(9.0 * leaf.mesh.vertex_areas)
    assert mesh.vertex_count - mesh.edge_count + mesh.triangle_count == 2  # two discs
    assert leaves.length == pytest.approx(3.0 * leaf.length)


def test_settling_brings_every_leaf_to_rest(small_scene, scene_leaf, device) -> None:
    scene = changed(
        small_scene,
        leaves=VARIED | {"count": 5, "camber": False},
        motion__settle=True,
        motion__gravity=[0.0, 0.0, -0.02],
    )
    simulation = Simulation(scene, scene_leaf(scene), device)
    simulation.settle()
    assert simulation.settled.settled and simulation.settled.swing <= 1e-3
    rest = simulation.read_frame(1).points
    simulation.motion.advance(1.0 / scene.time.fps, 1)
    assert np.abs(simulation.read_frame(1).points - rest).max() < 1e-3 * scene.leaf.length


@pytest.fixture(scope="module")
def written(small_scene, tmp_path_factory) -> tuple[Path, dict]:
    """The USD of 5 varied leaves, and the frame that it should hold at its end."""
    from leafwarp.prepare import prepare_scene_leaf
    from leafwarp.run import output_paths, run_scene

    scene = changed(small_scene, leaves=VARIED | {"count": 5}, output__up_axis="Y", output__display_color=True)
    paths = output_paths(scene, tmp_path_factory.mktemp("many") / "many.usda")
    report = run_scene(scene, paths, frames=range(1, FRAMES + 1), progress_level=-1)
    leaves = prepare_scene_leaf(scene, None)
    *_, last = Simulation(scene, leaves).frames(FRAMES)
    return paths.usd, {"report": report, "leaves": leaves, "last": last}


def test_usd_has_a_prim_a_leaf_and_one_material(written) -> None:
    path, run = written
    assert check_usd(path) == []
    stage = Usd.Stage.Open(str(path))
    root = stage.GetDefaultPrim()
    assert root.GetPath() == "/Leaves" and Usd.ModelAPI(root).GetKind() == Kind.Tokens.assembly
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert len(meshes) == 5
    leaves, last = run["leaves"], run["last"]
    for index, (mesh, specimen, own) in enumerate(zip(meshes, leaves.specimens, leaves.vertex_slices, strict=True)):
        model = mesh.GetPrim().GetParent()
        assert model.GetPath() == f"/Leaves/leaf_{index + 1:04d}"
        assert Usd.ModelAPI(model).GetKind() == Kind.Tokens.component
        x, y, z = specimen.place
        assert list(UsdGeom.Xformable(model).GetLocalTransformation().ExtractTranslation()) == [x, z, -y]
        points = np.array(mesh.GetPointsAttr().Get(FRAMES))
        assert np.array_equal(points, last.points[own][:, (0, 2, 1)] * np.float32([1, 1, -1]))
        assert np.array_equal(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("water").Get(FRAMES), last.water[own])
        st = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get())
        assert st == pytest.approx(leaves.photos[0].uv, abs=1e-6)
        material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
        assert material.GetPath() == "/Leaves/mtl/photo"
    root.GetVariantSets().SetSelection("shading", "water")
    for mesh in meshes:
        material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
        assert material.GetPath() == "/Leaves/mtl/water"
    assert run["report"]["leaf"]["count"] == run["report"]["mesh"]["leaves"] == 5


def test_a_killed_run_of_many_leaves_keeps_its_frames(written, tmp_path) -> None:
    from leafwarp.usd.writer import UsdWriter

    _, run = written
    leaves, last = run["leaves"], run["last"]
    path = tmp_path / "killed.usd"
    rest = dataclasses.replace(last, index=0)
    writer = UsdWriter(path, leaves, rest, frames=range(1, 5), fps=24.0)
    writer.write(dataclasses.replace(last, index=1))
    writer.write(dataclasses.replace(last, index=2, points=last.points + np.float32(1.0)))
    assert check_usd(path, unfinished=True) == []  # never closed
    stage = Usd.Stage.Open(str(path))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Leaves/leaf_0005/leaf"))
    moved = last.points[leaves.vertex_slices[4]] + np.float32(1.0)
    assert np.array_equal(mesh.GetPointsAttr().Get(2), moved)


TWO_PHOTOS = """
[[leaf]]
image = "drawn.png"
length = "8 cm"
[[leaf]]
image = "other.png"
length = "4 cm"
camber = 0.0
"""


@pytest.fixture(scope="module")
def two_photos(small_scene) -> Path:
    """A scene of two photos: the drawn one, and it turned upside down and bluish."""
    picture = cv2.imread(str(small_scene.with_name("drawn.png")))
    cv2.imwrite(str(small_scene.with_name("other.png")), picture[::-1])
    tables = small_scene.read_text().split("[mesh]")[1]
    path = small_scene.with_name("two.toml")
    path.write_text(TWO_PHOTOS + "[mesh]" + tables)
    return path


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


def test_a_contact_sheet_shows_all_leaves(small_scene, scene_leaf, device) -> None:
    """Blue patches of water, and green leaves in the picture: as many of each as there are leaves."""
    scene = changed(small_scene, leaves={"count": 4})
    leaves = scene_leaf(scene)
    simulation = Simulation(scene, leaves, device)
    sheet = ContactSheet(leaves, [1], device)
    sheet.capture(simulation.read_frame(1), simulation.state["water_now"].numpy())
    red, green, blue = np.moveaxis(sheet.draw().astype(int), 2, 0)
    legend = red.shape[0] - 120
    for shown in (blue > np.maximum(red, green) + 30, green > np.maximum(red, blue) + 30):
        count, _, boxes, _ = cv2.connectedComponentsWithStats(shown[:legend].astype(np.uint8))
        assert (boxes[1:, cv2.CC_STAT_AREA] > 500).sum() == 4
        assert count <= 4 + 40  # the rest are specks of a margin


BAD = {
    "count = 0": "leaves.count = 0: accepted: 1 to 100000",
    "count = 2\nsize = 2.0": "leaves.size = 2.0: accepted: 0 to 0.9",
    "count = 2\narrangement = 'heap'": "leaves.arrangement = 'heap': accepted: 'grid' or 'stem'",
    "count = 2\nweight = 1": "leaves.weight: unknown key",
    "seed = 1": "leaves.count: missing",
    "count = 2\n[motion]\nmethod = 'quasistatic'": "motion.method = 'quasistatic': accepted with [leaves]: 'explicit'",
    "count = 2\nphotos = [{image = 'drawn.png'}]": "leaves.photos[0]: give either 'length' or 'pixels_per_metre'",
    "count = 2\nphotos = [{length = 0.1}]": "leaves.photos[0].image: missing",
    "count = 90000\n[maps]\nsize = 64": "a size of 27 or less",
}


@pytest.mark.parametrize("text", BAD)
def test_bad_input_is_one_line(text: str, small_scene, tmp_path, capsys) -> None:
    tables = {line.strip("[]") for line in text.splitlines() if line.startswith("[")}
    kept = []
    skipping = False
    for line in small_scene.read_text().splitlines():
        if line.startswith("["):
            skipping = line.strip("[]") in tables
        if not skipping:
            kept.append(line)
    scene = small_scene.with_name("bad_leaves.toml")
    scene.write_text("\n".join([*kept, "[leaves]", text]) + "\n")
    assert main(["run", str(scene), "-o", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert BAD[text] in error and error.count("\n") == 1 and "Traceback" not in error


def test_a_material_says_why_it_cannot_have_many_leaves(small_scene) -> None:
    data = changed(small_scene).model_dump(exclude_unset=True) | {"leaves": {"count": 2}}
    data |= {"material": {"preset": "tree"}, "structure": {}, "shrink": None, "curl": None}
    with pytest.raises(
        InputError, match=r"motion\.method = 'quasistatic' \(from \[material\]\): accepted with \[leaves\]"
    ):
        Scene.checked(data, "scene")


def test_an_image_of_a_map_is_of_one_photo(two_photos) -> None:
    with pytest.raises(InputError, match=r"maps\.venation: an image is accepted with one photo; here are 2"):
        changed(two_photos, maps__venation="drawn.png")


def test_maps_follow_the_mesh_and_finer_ones_are_told(small_scene) -> None:
    data = changed(small_scene, leaves__count=2, mesh__vertices=200).model_dump(exclude_unset=True)
    del data["maps"]
    assert Scene.checked(data, "scene").maps.shape == (64, 64)
    data["maps"] = {"size": 256}
    (warning,) = [line for line in Scene.checked(data, "scene").warnings if line.startswith("maps.size")]
    assert "usual: 64, in 6%" in warning


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


def test_prescribed_water_and_tradeoff_refuse_what_they_cannot_do(small_scene, tmp_path) -> None:
    from leafwarp.study.tradeoff import run_tradeoff

    scene = changed(small_scene, leaves__count=2)
    with pytest.raises(InputError, match="leave this table out"):
        run_tradeoff(scene, tmp_path)
    data = scene.model_dump(exclude_unset=True)
    for table in ("fluid", "transpiration", "source", "maps"):
        data.pop(table, None)
    data["water"] = {"curve": [[0.0, 1.0], [10.0, 0.5]]}
    data["leaves"]["water"] = 0.1
    with pytest.raises(InputError, match=r"leaves\.water needs \[fluid\]"):
        Scene.checked(data, "scene")


def test_a_scene_without_leaves_loads_nothing_of_them(small_scene, tmp_path) -> None:
    import subprocess
    import sys

    code = (
        "import sys; from pathlib import Path; from leafwarp.scene.file import load_scene; "
        "from leafwarp.run import output_paths, run_scene; "
        f"scene = load_scene(Path({str(small_scene)!r}), ['output.contact_sheet=true']); "
        f"run_scene(scene, output_paths(scene, Path({str(tmp_path)!r})), frames=range(1, 2), progress_level=-1); "
        "print([name for name in sys.modules if name in ('leafwarp.leaf.leaves', 'leafwarp.leaf.arrange')])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
