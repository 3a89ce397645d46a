"""Pictures of the leaf: orientation, both sides, light and shadow, framing; the contact sheet's layout and panels."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from leafwarp.errors import InputError, OutputError
from leafwarp.frame import Frame
from leafwarp.leaf.leaf import Leaf
from leafwarp.render.color import to_linear, to_srgb
from leafwarp.render.contact_sheet import ContactSheet, _lowest, _time_labels, choose_frames
from leafwarp.render.layout import TALLEST, WIDEST, arrange
from leafwarp.render.renderer import LIGHT, PAPER, LeafRenderer
from leafwarp.render.water_picture import WaterPicture, water_colors
from meshes import leaf_of, mesh_of, strip

ABOVE = (0.0, 0.0, 1.0)
UP = np.array([0.0, 0.0, 1.0])
RED, GREEN, BLUE, YELLOW = (200, 40, 40), (40, 180, 40), (40, 40, 200), (200, 190, 40)
# 8-bit levels: a rounding of the texture's table and one of the picture's.
ROUNDING = 2


def square(size: float = 0.1) -> Leaf:
    """A flat square whose texture is red, green, blue and yellow, from the upper left on clockwise."""
    leaf = leaf_of(mesh_of(size * np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), [[0, 1, 2], [0, 2, 3]]))
    texture = np.zeros((40, 40, 3), np.uint8)
    texture[:20, :20], texture[:20, 20:] = RED, GREEN
    texture[20:, 20:], texture[20:, :20] = BLUE, YELLOW
    return dataclasses.replace(leaf, texture=texture)


def lifted(leaf: Leaf, height: float = 0.0) -> np.ndarray:
    return np.column_stack([leaf.mesh.positions, np.full(leaf.mesh.vertex_count, height)])


def upward(leaf: Leaf, sign: float = 1.0) -> np.ndarray:
    return np.tile(sign * UP, (leaf.mesh.vertex_count, 1))


def renderer_of(leaf: Leaf, device: str, size: tuple[int, int] = (120, 120), **options) -> LeafRenderer:
    return LeafRenderer(leaf.mesh.triangles, leaf.uv, leaf.texture, device, *size, **{"gloss": 0.0, **options})


def bowl(leaf: Leaf, curvature: float = 8.0) -> tuple[np.ndarray, np.ndarray]:
    """A bowl and its normals."""
    points = lifted(leaf)
    points[:, 2] = 0.5 * curvature * (points[:, :2] ** 2).sum(axis=1)
    normals = np.column_stack([-curvature * points[:, 0], -curvature * points[:, 1], np.ones(len(points))])
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def quarters(picture: np.ndarray) -> list[np.ndarray]:
    """The middle pixels of the quarters, from the upper left on clockwise."""
    height, width = picture.shape[:2]
    places = ((0.25, 0.25), (0.25, 0.75), (0.75, 0.75), (0.75, 0.25))
    return [picture[int(row * height), int(column * width)].astype(int) for row, column in places]


def leaf_pixels(picture: np.ndarray) -> np.ndarray:
    """Where a saturated colour is: the ground and its shadow are grey."""
    return np.ptp(picture.astype(int), axis=2) > 40


@pytest.mark.parametrize("size", [1e-3, 0.1, 3.0], ids=["1 mm", "10 cm", "3 m"])
def test_a_flat_leaf_shows_its_texture_unturned_and_unchanged(size, device) -> None:
    leaf = square(size)
    renderer = renderer_of(leaf, device)
    renderer.fit_camera([lifted(leaf)], direction=ABOVE)
    picture = renderer.render(lifted(leaf), upward(leaf))
    for seen, painted in zip(quarters(picture), (RED, GREEN, BLUE, YELLOW), strict=True):
        assert np.abs(seen - painted).max() <= ROUNDING


def with_hole(leaf: Leaf) -> Leaf:
    """The same leaf with its upper left quarter cut out of the texture."""
    opacity = np.full(leaf.texture.shape[:2], 255, np.uint8)
    opacity[:20, :20] = 0
    return dataclasses.replace(leaf, texture=np.dstack([leaf.texture, opacity]))


def test_a_hole_shows_the_ground_and_the_rest_is_as_without(device) -> None:
    pictures = []
    for leaf in (square(), with_hole(square())):
        renderer = renderer_of(leaf, device)
        renderer.fit_camera([lifted(leaf)], direction=ABOVE)
        pictures.append(renderer.render(lifted(leaf), upward(leaf)))
    plain, holed = (quarters(picture) for picture in pictures)
    assert np.ptp(holed[0]) < 10 and holed[0].max() <= max(PAPER)  # the grey of a ground in shade
    for seen, painted in zip(holed[1:], plain[1:], strict=True):
        assert np.abs(seen - painted).max() <= ROUNDING


def test_a_hole_shows_the_blade_that_is_folded_behind_it(device) -> None:
    """Two squares, one over the other: through the upper one's hole the lower one's same quarter is no hole to see."""
    upper = with_hole(square())
    count = upper.mesh.vertex_count
    triangles = np.concatenate([upper.mesh.triangles, upper.mesh.triangles + count])
    # The lower square wears the texture turned by half a turn, so that blue lies under the hole.
    uv = np.concatenate([upper.uv, 1.0 - upper.uv])
    points = np.concatenate([lifted(upper, 0.02), lifted(upper)])
    renderer = LeafRenderer(triangles, uv, upper.texture, device, 120, 120, gloss=0.0)
    renderer.fit_camera([points], direction=ABOVE)
    seen = quarters(renderer.render(points, np.tile(UP, (2 * count, 1))))[0]
    assert seen.argmax() == 2 and seen[2] > 2 * seen[0]


def test_the_back_is_shown_mirrored_and_greyer(device) -> None:
    leaf = square()
    turned = lifted(leaf) * (-1, 1, -1)  # turned over about the y axis
    renderer = renderer_of(leaf, device)
    renderer.fit_camera([turned], direction=ABOVE)
    picture = renderer.render(turned, upward(leaf, -1.0))
    for seen, painted in zip(quarters(picture), (GREEN, RED, YELLOW, BLUE), strict=True):
        assert seen.argmax() == np.argmax(painted)
        assert np.ptp(seen) / seen.max() < 0.9 * np.ptp(painted) / max(painted)


def test_light_from_behind_shines_through_yellower(device) -> None:
    leaf = dataclasses.replace(square(), texture=np.full((4, 4, 3), 150, np.uint8))
    renderer = renderer_of(leaf, device)
    renderer.fit_camera([lifted(leaf)], direction=ABOVE)
    against = renderer.render(lifted(leaf), -upward(leaf))[60, 60].astype(int)  # normals away from the light
    lit = renderer.render(lifted(leaf), upward(leaf))[60, 60].astype(int)
    assert against.max() < lit.min()
    assert against[2] < against[0] - ROUNDING


@pytest.mark.parametrize("light", [LIGHT, (0.5, -0.4, 0.8)])
def test_the_shadow_is_dark_and_lies_away_from_the_light(light, device) -> None:
    leaf = square()
    high = lifted(leaf, 0.08)
    renderer = renderer_of(leaf, device, (200, 200), light=light)
    renderer.fit_camera([lifted(leaf), high], direction=ABOVE)
    picture = renderer.render(high, upward(leaf))
    leaf_places = np.argwhere(leaf_pixels(picture))
    shadow = np.argwhere(~leaf_pixels(picture) & (picture.astype(int).sum(axis=2) < 0.9 * sum(PAPER)))
    assert len(shadow) > 200
    shift = shadow.mean(axis=0) - leaf_places.mean(axis=0)  # rows go down, columns to the right
    assert shift[1] * -light[0] > 0.0 and shift[0] * light[1] > 0.0


def test_ground_out_of_reach_is_plain_paper(device) -> None:
    leaf = square()
    renderer = renderer_of(leaf, device)
    renderer.set_camera((0.05, 0.05, 0.0), 0.5, ABOVE)
    picture = renderer.render(lifted(leaf), upward(leaf))
    assert leaf_pixels(picture).any()
    border = np.concatenate([picture[[0, -1]].reshape(-1, 3), picture[:, [0, -1]].reshape(-1, 3)])
    assert (border == PAPER).all()


def test_a_fold_shades_itself(device) -> None:
    """A roof over a floor, one mesh: the floor under it is darker than the floor in the open."""
    positions = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.1, 0.5, 0.4], [0.5, 0.5, 0.4], [0.5, 1, 0.4],
                          [0.1, 1, 0.4]])  # fmt: skip
    grid = np.linspace(0.0, 1.0, 9)
    floor = np.array([[x, y, 0.0] for y in grid for x in grid])
    cells = [(9 * j + i, 9 * j + i + 1, 9 * j + i + 10, 9 * j + i + 9) for j in range(8) for i in range(8)]
    triangles = [t for a, b, c, d in cells for t in ((a, b, c), (a, c, d))] + [(81, 82, 83), (81, 83, 84)]
    points = 0.1 * np.concatenate([floor, positions[4:]])
    texture = np.full((4, 4, 3), 150, np.uint8)
    renderer = LeafRenderer(np.array(triangles), np.full((85, 2), 0.5), texture, device, 120, 120, gloss=0.0)
    renderer.set_camera((0.05, 0.05, 0.0), 0.08, (0.0, -0.8, 0.6))
    picture = renderer.render(points, np.tile(UP, (85, 1)))
    under, open_air = renderer_pixel(renderer, (0.05, 0.045, 0.0)), renderer_pixel(renderer, (0.09, 0.01, 0.0))
    assert int(picture[under].sum()) < 0.85 * int(picture[open_air].sum())


def renderer_pixel(renderer: LeafRenderer, point: tuple[float, float, float]) -> tuple[int, int]:
    """Row and column at which a point is seen."""
    x, y, _ = renderer.view.project(np.array([point]))[0]
    return int(y * renderer.size[1]), int(x * renderer.size[0])


def test_tint_replaces_the_colour_and_keeps_light_and_dark(device) -> None:
    leaf = square()
    renderer = renderer_of(leaf, device)
    renderer.fit_camera([lifted(leaf)], direction=ABOVE)
    plain = renderer.render(lifted(leaf), upward(leaf))
    brown = np.tile([0.23, 0.11, 0.04], (4, 1))
    tinted = renderer.render(lifted(leaf), upward(leaf), brown)
    for seen in quarters(tinted):
        color = to_linear(seen)
        assert color / color.sum() == pytest.approx(brown[0] / brown[0].sum(), abs=0.02)
    assert quarters(tinted)[2].sum() < quarters(tinted)[3].sum()  # blue is darker than yellow
    none_of_it = renderer.render(lifted(leaf), upward(leaf), np.column_stack([brown, np.zeros(4)]))
    assert (none_of_it == plain).all()


def test_two_pictures_are_the_same_to_the_bit(device) -> None:
    leaf = dataclasses.replace(strip(0.1, 0.04, 12), texture=square().texture)
    pictures = []
    for _ in range(2):
        renderer = renderer_of(leaf, device)
        renderer.fit_camera([bowl(leaf)[0]])
        pictures.append(renderer.render(*bowl(leaf)))
    assert (pictures[0] == pictures[1]).all()
    assert (pictures[0] == renderer.render(*bowl(leaf))).all()


def test_outlines_are_smooth(device) -> None:
    """Coverage of the pixels along a slanted edge: with 4 x 4 samples at least 8 levels, with one sample 2."""
    leaf = dataclasses.replace(square(), texture=np.zeros((4, 4, 3), np.uint8))
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    points = np.column_stack([leaf.mesh.positions @ turn.T, np.zeros(4)])
    levels = {}
    for samples in (1, 4):
        renderer = renderer_of(leaf, device, samples=samples)
        renderer.fit_camera([points], direction=ABOVE)
        renderer._ground.shadow_depth = 0.0
        levels[samples] = len(np.unique(renderer.render(points, upward(leaf))))
    assert levels[1] <= 3 and levels[4] >= 8


@pytest.mark.parametrize("size", [(160, 90), (60, 150)])
def test_every_pose_is_framed_whole_and_alike(size, device) -> None:
    leaf = dataclasses.replace(strip(0.3, 0.02, 30), texture=np.full((8, 8, 3), RED, np.uint8))
    bent = lifted(leaf)
    bent[:, 2] = -4.0 * bent[:, 0] ** 2
    small = 0.5 * lifted(leaf)
    renderer = renderer_of(leaf, device, size)
    renderer.fit_camera([lifted(leaf), bent, small])
    seen = []
    for pose in (lifted(leaf), bent, small):
        red = leaf_pixels(renderer.render(pose, upward(leaf)))
        assert not red[[0, -1]].any() and not red[:, [0, -1]].any()
        seen.append(int(red.sum()))
    assert seen[2] == pytest.approx(0.25 * seen[0], rel=0.15)  # shrinkage shows: no pose gets its own zoom


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_position_that_is_not_finite_is_refused_by_vertex(bad, device) -> None:
    leaf = square()
    points = lifted(leaf)
    points[2, 1] = bad
    with pytest.raises(InputError, match="vertex 2"):
        renderer_of(leaf, device).render(points, upward(leaf))
    with pytest.raises(InputError, match="vertex 2"):
        renderer_of(leaf, device).fit_camera([points])


def test_bad_arguments_are_refused(device) -> None:
    leaf = square()
    with pytest.raises(InputError, match=r"picture 0 x 10"):
        renderer_of(leaf, device, (0, 10))
    with pytest.raises(InputError, match="light"):
        renderer_of(leaf, device, light=(0.0, 1.0, -0.5))
    with pytest.raises(InputError, match="triangles"):
        LeafRenderer(np.array([[0, 1, 4]]), leaf.uv, leaf.texture, device)
    with pytest.raises(InputError, match="radius"):
        renderer_of(leaf, device).set_camera((0.0, 0.0, 0.0), 0.0)
    with pytest.raises(InputError, match="direction"):
        renderer_of(leaf, device).set_camera((0.0, 0.0, 0.0), 1.0, (0.0, 0.0, 0.0))
    with pytest.raises(InputError, match=r"tint: shape \(3, 3\)"):
        renderer_of(leaf, device).render(lifted(leaf), upward(leaf), np.ones((3, 3)))


def test_an_empty_view_is_paper(device) -> None:
    leaf = square()
    renderer = renderer_of(leaf, device)
    renderer.set_camera((50.0, 0.0, 0.0), 0.1, ABOVE)
    assert (renderer.render(lifted(leaf), upward(leaf)) == PAPER).all()


def test_a_collapsed_leaf_and_a_camera_inside_give_a_picture(device) -> None:
    leaf = square()
    renderer = renderer_of(leaf, device)
    assert renderer.render(np.zeros((4, 3)), np.zeros((4, 3))).shape == (120, 120, 3)
    renderer.set_camera((0.05, 0.05, 0.0), 1e-3, (0.0, -1.0, 0.0))
    assert renderer.render(lifted(leaf), np.full((4, 3), np.nan)).shape == (120, 120, 3)


def test_srgb_round_trip() -> None:
    levels = np.arange(256, dtype=np.uint8)
    assert (to_srgb(to_linear(levels)) == levels).all()


@pytest.mark.parametrize(("first", "last", "count"), [(1, 240, 8), (1, 3, 3), (5, 5, 1), (10, 17, 8), (1, 9, 8)])
def test_choose_frames_covers_first_and_last(first: int, last: int, count: int) -> None:
    frames = choose_frames(first, last)
    assert (frames[0], frames[-1], len(frames)) == (first, last, count)
    assert (np.diff(frames) > 0).all()


def test_water_colours_darken_with_water_for_every_kind_of_eye() -> None:
    linear = to_linear(water_colors(np.linspace(0.0, 1.0, 41)))
    assert (np.diff(linear @ (0.2126, 0.7152, 0.0722)) < 0).all()
    # Eyes without the red or the green receptor (Vienot et al. 1999, both from the mean of red and green).
    for weights in ((0.11, 0.89), (0.29, 0.71)):
        two_colours = np.stack([linear[:, :2] @ weights, linear[:, 2]], axis=1)
        assert np.abs(np.diff(two_colours, axis=0)).sum(axis=1).min() > 1e-3


@pytest.mark.parametrize("shape", [(6, 4), (256, 100), (1, 3)], ids=str)
def test_water_map_has_row_0_at_the_bottom(shape) -> None:
    leaf = dataclasses.replace(square(), mask=np.ones(shape, bool))
    water = np.tile(np.linspace(0.0, 1.0, shape[1]), (shape[0], 1))
    water[: shape[0] // 2] = 0.0  # the bottom half is dry; the top half gets wetter to the right
    picture = WaterPicture(leaf, (40, 40), PAPER).from_map(water)
    upper_left, upper_right, lower_right, lower_left = quarters(picture)
    dry = water_colors(0.0).astype(int)
    if shape[0] > 1:
        assert np.abs(lower_left - dry).max() <= ROUNDING and np.abs(lower_right - dry).max() <= ROUNDING
    assert upper_right.sum() < upper_left.sum() - 60


def test_water_map_takes_nothing_from_cells_outside_the_leaf() -> None:
    mask = np.ones((10, 10), bool)
    mask[:, 8:] = False
    leaf = dataclasses.replace(square(), mask=mask)
    water = np.where(mask, 1.0, 0.0)
    picture = WaterPicture(leaf, (40, 40), PAPER).from_map(water)
    assert np.abs(picture[20, 5:35].astype(int) - water_colors(1.0)).max() <= ROUNDING


def test_vertex_water_lies_where_the_vertices_are() -> None:
    leaf = strip(0.1, 0.1, 24)
    picture = WaterPicture(leaf, (60, 60), PAPER)
    even = picture.from_vertices(np.full(leaf.mesh.vertex_count, 0.5))
    assert np.abs(even[5:55, 5:55].astype(int) - water_colors(0.5)).max() <= ROUNDING
    wet_above = picture.from_vertices((leaf.mesh.positions[:, 1] > 0.0).astype(np.float32))
    upper_left, _, lower_right, _ = quarters(wet_above)
    assert np.abs(upper_left - water_colors(1.0)).max() <= ROUNDING
    assert np.abs(lower_right - water_colors(0.0)).max() <= ROUNDING


@pytest.mark.parametrize("width_over_height", [0.1, 0.4, 0.7, 1.0, 2.0, 10.0])
@pytest.mark.parametrize("count", [1, 2, 3, 5, 7, 8])
def test_layouts_fit_and_nothing_overlaps(count: int, width_over_height: float) -> None:
    water = (0.1 * width_over_height, 0.1)
    layout = arrange(count, water, (1.2 * water[0], 0.8 * water[1]))
    taken = np.zeros(layout.size[::-1], int)
    for index in range(count):
        for (x, y), (w, h) in (
            (layout.water_corner(index), layout.water),
            (layout.leaf_corner(index), layout.leaf),
        ):
            assert x >= 0 and y >= 0 and x + w <= layout.size[0] and y + h <= layout.size[1]
            taken[y : y + h, x : x + w] += 1
    assert taken.max() == 1
    assert layout.size[0] <= WIDEST and layout.size[1] <= TALLEST
    # The panels have the leaf's true proportions, but for whole pixels.
    assert layout.water[0] == pytest.approx(layout.scale * water[0], abs=1.0)
    assert layout.water[1] == pytest.approx(layout.scale * water[1], abs=1.0)
    assert max(layout.water) >= 150


def test_time_labels_share_one_unit() -> None:
    assert _time_labels([0.0, 1800.0, 3600.0]) == ["0.0 min", "30.0 min", "60.0 min"]
    assert _time_labels([0.0, 86400.0]) == ["0.0 h", "24.0 h"]
    assert _time_labels([86400.0, 864000.0]) == ["1.0 d", "10.0 d"]
    assert _time_labels([0.0, 0.0]) == ["0.0 s", "0.0 s"]


def frames_of(leaf: Leaf, count: int, driest: float = 0.2) -> list[Frame]:
    water = np.linspace(1.0, driest, count, dtype=np.float32)
    vertices = leaf.mesh.vertex_count
    normals = upward(leaf).astype(np.float32)
    return [
        Frame(k + 1, 3600.0 * k, lifted(leaf).astype(np.float32), normals, 0 * normals, np.full(vertices, water[k]))
        for k in range(count)
    ]


def test_colours_span_what_the_scene_shows() -> None:
    leaf = square()
    assert _lowest(leaf, [(frame, None) for frame in frames_of(leaf, 3, 0.2)]) == 0.0
    assert _lowest(leaf, [(frame, None) for frame in frames_of(leaf, 3, 0.87)]) == pytest.approx(0.8)
    assert _lowest(leaf, [(frame, None) for frame in frames_of(leaf, 3, 1.0)]) == pytest.approx(0.9)


@pytest.mark.parametrize("shape", [(0.1, 0.02), (0.02, 0.3), (0.1, 0.1)], ids=["landscape", "blade", "square"])
@pytest.mark.parametrize("count", [0, 1, 3, 8])
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
    assert 400 <= picture.shape[1] <= WIDEST and 200 <= picture.shape[0] <= TALLEST
    assert [p.name for p in tmp_path.iterdir()] == ["sheet.png"]
    edges = np.concatenate([picture[[0, -1]].reshape(-1, 3), picture[:, [0, -1]].reshape(-1, 3)])
    assert (edges == PAPER[::-1]).all()
    saturated = np.abs(picture[..., ::-1].astype(int) - water_colors(1.0)).max(axis=2) <= ROUNDING
    # The first moment's water is saturated; with no moment only the legend's end has that colour.
    assert (saturated.sum() > 2000) == (count > 0)


def test_a_sheet_shows_the_display_colour_once_it_has_changed(device) -> None:
    leaf = dataclasses.replace(square(), texture=np.full((8, 8, 3), GREEN, np.uint8))
    green, brown = (np.tile(np.float32(c), (4, 1)) for c in ((0.06, 0.27, 0.04), (0.4, 0.2, 0.05)))
    first, second = frames_of(leaf, 2)
    redder = {}
    for name, colors in (("kept", (green, green)), ("dried", (green, brown)), ("none", (None, None))):
        sheet = ContactSheet(leaf, [1, 2], device)
        for frame, color in zip((first, second), colors, strict=True):
            sheet.capture(dataclasses.replace(frame, color=color))
        picture = sheet.draw().astype(int)
        redder[name] = int(((picture[..., 0] > picture[..., 1] + 30) & (picture[..., 1] > picture[..., 2] + 30)).sum())
        if name == "kept":
            kept = picture
    assert redder["dried"] > redder["none"] + 1000
    assert (picture == kept).all()  # an unchanged display colour leaves the photo alone


def test_a_sheet_that_cannot_be_written_says_so(tmp_path: Path, device) -> None:
    leaf = dataclasses.replace(square(), mask=np.ones((4, 4), bool))
    sheet = ContactSheet(leaf, [1], device)
    sheet.capture(frames_of(leaf, 1)[0])
    with pytest.raises(OutputError, match="cannot be written"):
        sheet.save(tmp_path / "none" / "sheet.png")
