"""How the leaves of a scene differ, and where they stand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from leafwarp.leaf.arrange import arrange_leaves, axis_angle, grid_cell, least_spacing
from leafwarp.scene.leaf import LeafTable
from leafwarp.scene.leaves import LeavesTable
from many_leaves import VARIED, changed


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
