"""Pictures of the leaf: orientation, both sides, shadow, layout."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from leafwarp.errors import InputError, OutputError
from leafwarp.leaf.leaf import Leaf
from leafwarp.render.contact_sheet import PAPER, ContactSheet, choose_frames
from leafwarp.render.renderer import LIGHT, LeafRenderer, to_linear, to_srgb
from leafwarp.render.water_picture import map_picture, vertex_picture, water_colors
from leafwarp.sim.frame import Frame
from meshes import leaf_of, mesh_of, strip

ABOVE = np.array([0.0, 0.0, 1.0])
UP = np.array([0.0, 0.0, 1.0])


def square(size: float = 0.1) -> Leaf:
    """A flat square whose texture is red, green, blue and yellow, from the upper left on clockwise."""
    leaf = leaf_of(mesh_of(size * np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), [[0, 1, 2], [0, 2, 3]]))
    texture = np.zeros((40, 40, 3), np.uint8)
    texture[:20, :20], texture[:20, 20:] = (220, 30, 30), (30, 200, 30)
    texture[20:, 20:], texture[20:, :20] = (30, 30, 220), (220, 220, 30)
    return dataclasses.replace(leaf, texture=texture)


def lifted(leaf: Leaf, height: float = 0.0) -> np.ndarray:
    return np.column_stack([leaf.mesh.positions, np.full(leaf.mesh.vertex_count, height)])


def renderer_of(leaf: Leaf, device: str, size: tuple[int, int] = (120, 120)) -> LeafRenderer:
    return LeafRenderer(leaf.mesh.triangles, leaf.uv, leaf.texture, size, 1, device)


def hue(pixel: np.ndarray) -> str:
    strong = pixel > 0.6 * pixel.max()
    return {(1, 0, 0): "red", (0, 1, 0): "green", (0, 0, 1): "blue", (1, 1, 0): "yellow"}.get(tuple(strong * 1), "grey")


def test_no_mirror_and_no_upside_down(device) -> None:
    leaf = square()
    renderer = renderer_of(leaf, device)
    renderer.frame([lifted(leaf)], view=ABOVE)
    picture = renderer.render(lifted(leaf), np.tile(UP, (4, 1)))
    corners = [picture[j, i] for j, i in ((30, 30), (30, 90), (90, 90), (90, 30))]
    assert [hue(c) for c in corners] == ["red", "green", "blue", "yellow"]


def test_the_texture_is_shaded_in_linear_light(device) -> None:
    leaf = square()
    renderer = renderer_of(leaf, device)
    renderer.frame([lifted(leaf)], view=ABOVE)
    picture = renderer.render(lifted(leaf), np.tile(UP, (4, 1)))
    shade = to_linear(picture[30, 30]) / to_linear(leaf.texture[5, 5])
    # Level in the light: the key light's cosine and all of the sky, alike in every channel but for 8-bit rounding.
    assert shade == pytest.approx(0.82 * LIGHT[2] + 0.42, rel=0.05)


def test_the_back_is_shown_mirrored_and_paler(device) -> None:
    leaf = square()
    turned = lifted(leaf) * (-1, 1, -1)  # turned over about the y axis
    renderer = renderer_of(leaf, device)
    renderer.frame([turned], view=ABOVE)
    picture = renderer.render(turned, np.tile(-UP, (4, 1)))
    assert [hue(picture[j, i]) for j, i in ((30, 30), (30, 90))] == ["green", "red"]
    front = leaf.texture[5, 5].astype(float)
    back = picture[30, 90].astype(float)
    assert (back.max() - back.min()) / back.max() < (front.max() - front.min()) / front.max()


def test_the_shadow_falls_away_from_the_light(device) -> None:
    leaf = square()
    high = lifted(leaf, 0.05)
    renderer = renderer_of(leaf, device, (200, 200))
    renderer.frame([lifted(leaf), high], margin=0.5, view=ABOVE)
    picture = renderer.render(high, np.tile(UP, (4, 1))).astype(int).sum(axis=2)
    dark = np.argwhere(picture < 0.9 * picture[0, 0])
    leaf_only = renderer.render(lifted(leaf), np.tile(UP, (4, 1))).astype(int).sum(axis=2)
    lit = np.argwhere(leaf_only < 0.9 * leaf_only[0, 0])
    shift = dark.mean(axis=0) - lit.mean(axis=0)  # rows go down, columns to the right
    assert shift[1] * -LIGHT[0] > 0.5  # the light comes from the left (x < 0): the shadow lies to the right
    assert shift[0] * LIGHT[1] > 0.2  # and from the top (y > 0): the shadow lies below


def test_two_pictures_are_the_same_to_the_bit(device) -> None:
    leaf = dataclasses.replace(strip(0.1, 0.04, 12), texture=square().texture)
    points = lifted(leaf)
    points[:, 2] = 2.0 * points[:, 0] ** 2
    normals = np.tile(UP, (len(points), 1))
    pictures = []
    for _ in range(2):
        renderer = renderer_of(leaf, device)
        renderer.frame([points])
        pictures.append(renderer.render(points, normals))
    assert (pictures[0] == pictures[1]).all()


def test_every_pose_is_framed_whole(device) -> None:
    leaf = dataclasses.replace(strip(0.3, 0.02, 30), texture=np.zeros((8, 8, 3), np.uint8))
    bent = lifted(leaf)
    bent[:, 2] = -4.0 * bent[:, 0] ** 2
    renderer = renderer_of(leaf, device, (160, 90))
    renderer.frame([lifted(leaf), bent])
    for pose in (lifted(leaf), bent):
        picture = renderer.render(pose, np.tile(UP, (len(pose), 1)))
        black = (picture < 60).all(axis=2)
        assert black.sum() > 50
        assert not black[[0, -1]].any() and not black[:, [0, -1]].any()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_position_that_is_not_finite_is_refused(bad, device) -> None:
    leaf = square()
    points = lifted(leaf)
    points[2, 1] = bad
    with pytest.raises(InputError, match="not a finite number"):
        renderer_of(leaf, device).render(points, np.tile(UP, (4, 1)))


def test_srgb_round_trip() -> None:
    levels = np.arange(256, dtype=np.uint8)
    assert (to_srgb(to_linear(levels)) == levels).all()


@pytest.mark.parametrize(("first", "last", "count"), [(1, 240, 8), (1, 3, 3), (5, 5, 1), (10, 17, 8)])
def test_choose_frames_covers_first_and_last(first: int, last: int, count: int) -> None:
    frames = choose_frames(first, last)
    assert (frames[0], frames[-1], len(frames)) == (first, last, count)
    assert all(b > a for a, b in pairwise(frames))


def test_water_ramp_gets_darker_with_water() -> None:
    luminance = to_linear(np.round(water_colors(np.linspace(0, 1, 101))).astype(np.uint8)) @ (0.2126, 0.7152, 0.0722)
    assert (np.diff(luminance) < 0).all()


def test_map_picture_has_row_0_at_the_bottom() -> None:
    mask = np.ones((10, 6), bool)
    mask[0, :] = False
    water = np.linspace(0, 1, 10)[:, None] + np.zeros((1, 6))
    colors, coverage = map_picture(water, mask, (6, 10))
    assert coverage[-1].max() == 0.0 and coverage[:-1].min() == 1.0
    assert colors[0, 0] == pytest.approx(water_colors(1.0))


def test_vertex_picture_has_the_same_place_and_colors_as_the_leaf() -> None:
    leaf = square()
    colors, coverage = vertex_picture(leaf, np.full(4, 0.5), (30, 30))
    assert coverage.mean() > 0.98
    assert colors[15, 15] == pytest.approx(water_colors(0.5), abs=1.0)


def frames_of(leaf: Leaf, count: int) -> list[Frame]:
    water = np.linspace(1.0, 0.2, count, dtype=np.float32)
    vertices = leaf.mesh.vertex_count
    normals = np.tile(UP.astype(np.float32), (vertices, 1))
    return [
        Frame(k + 1, 3600.0 * k, lifted(leaf).astype(np.float32), normals, 0 * normals, np.full(vertices, water[k]))
        for k in range(count)
    ]


@pytest.mark.parametrize("shape", [(0.1, 0.02), (0.02, 0.3), (0.1, 0.1)], ids=["landscape", "blade", "square"])
@pytest.mark.parametrize("count", [1, 3, 8])
def test_sheets_of_any_leaf_and_count_fit(shape, count, device, tmp_path: Path) -> None:
    width, height = shape
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]])
    leaf = dataclasses.replace(leaf_of(mesh_of(corners, [[0, 1, 2], [0, 2, 3]])), texture=square().texture)
    leaf = dataclasses.replace(leaf, mask=np.ones((12, 7), bool))
    sheet = ContactSheet(leaf, range(1, count + 1), device)
    for frame in frames_of(leaf, count):
        sheet.capture(frame, np.full((12, 7), frame.water[0]))
    path = tmp_path / "sheet.png"
    sheet.save(path)
    picture = cv2.imread(str(path))
    assert 400 <= picture.shape[1] <= 2000 and 300 <= picture.shape[0] <= 2600
    assert [p.name for p in tmp_path.iterdir()] == ["sheet.png"]
    edges = np.concatenate([picture[[0, -1]].reshape(-1, 3), picture[:, [0, -1]].reshape(-1, 3)])
    assert (edges == PAPER[::-1]).all()
    # The first moment's water is saturated: its colour is on the sheet.
    assert (np.abs(picture[..., ::-1].astype(int) - np.round(water_colors(1.0))).max(axis=2) <= 2).sum() > 200


def test_a_sheet_that_cannot_be_written_says_so(tmp_path: Path, device) -> None:
    leaf = dataclasses.replace(square(), mask=np.ones((4, 4), bool))
    sheet = ContactSheet(leaf, [1], device)
    sheet.capture(frames_of(leaf, 1)[0])
    with pytest.raises(OutputError, match="cannot be written"):
        sheet.save(tmp_path / "none" / "sheet.png")
