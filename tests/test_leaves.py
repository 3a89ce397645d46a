"""Many leaves in one scene: each is as if it were alone, in the launches of one."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from leafwarp.cli import main
from leafwarp.errors import InputError
from leafwarp.leaf.arrange import axis_angle
from leafwarp.leaf.leaves import Leaves, gather_leaves
from leafwarp.leaf.specimen import Specimen
from leafwarp.render.contact_sheet import ContactSheet
from leafwarp.scene import Scene
from leafwarp.sim.simulation import Simulation
from many_leaves import VARIED, changed, computed

# Alike leaves have other neighbours in a block of lanes and in a line, which changes nothing that they compute: their
# values are the same to the last bit. A leaf of another size shares them with none, and its water's exchange is divided
# by the square of a size that is no power of 2.
ROUNDING = {"float32": 2e-5, "float64": 1e-12}


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
        mesh__vertices=40,
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


def test_settling_waits_for_the_slowest_leaf(small_scene, scene_leaf, device) -> None:
    """A small one hangs down and is at rest at once; a large soft one lies flat, and droops by its length."""
    scene = changed(
        small_scene,
        mesh__vertices=40,
        leaves={"count": 2, "camber": False},
        motion__settle=True,
        motion__gravity=[0.0, 0.0, -0.1],
    )
    photo = scene_leaf(changed(small_scene, mesh__vertices=40))
    angle, up = axis_angle(photo), np.array([0.0, 0.0, 1.0])
    axis = np.array([np.cos(angle), np.sin(angle), 0.0])
    across = np.cross(up, axis)
    tip_down = -np.outer(up, axis) + np.outer(across, across) + np.outer(axis, up)
    specimens = [Specimen(size=0.5, rotation=tip_down), Specimen(stiffness=0.5, rotation=np.eye(3))]

    def settled(*chosen: Specimen) -> tuple[np.ndarray, np.ndarray]:
        simulation = Simulation(scene, gather_leaves([photo], [0] * len(chosen), chosen), device)
        start = simulation.read_frame(1).points.copy()
        simulation.motion.settle(tolerance=3e-4)  # what is compared at a thousandth may swing by less
        return start, simulation.read_frame(1).points.copy()

    _, together = settled(*specimens)
    ways = []
    for specimen, found in zip(specimens, np.split(together, 2), strict=True):
        start, rest = settled(specimen)
        ways.append(np.abs(rest - start).max() / photo.length)
        # Where it comes to rest by itself; let go when the small one has come to rest it is a hundredth short of that.
        assert np.abs(found - rest).max() < 1e-3 * specimen.size * photo.length
    assert ways[0] < 0.01 and ways[1] > 0.5


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


def test_maps_follow_the_mesh_and_finer_ones_are_told(small_scene) -> None:
    data = changed(small_scene, leaves__count=2, mesh__vertices=200).model_dump(exclude_unset=True)
    del data["maps"]
    assert Scene.checked(data, "scene").maps.shape == (64, 64)
    data["maps"] = {"size": 256}
    (warning,) = [line for line in Scene.checked(data, "scene").warnings if line.startswith("maps.size")]
    assert "usual: 64, in 6%" in warning


def test_prescribed_water_and_tradeoff_refuse_what_they_cannot_do(small_scene, tmp_path) -> None:
    from leafwarp.study.tradeoff.study import run_tradeoff

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
