"""The overlay: every sign lies where the photo has the thing, and the picture's size is bounded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from leafwarp.leaf.image.photo import Photo
from leafwarp.leaf.leaf import Findings, Leaf, LeafMesh, MapFrame
from leafwarp.leaf.mesh.topology import mesh_from_triangles
from leafwarp.leaf.overlay import BASE, CLEAR, DARK, LONGEST, OUTLINE, PANEL, VEIN, draw_overlay

PIXEL = 1e-4  # [m]
BLUE = (0, 0, 255)


def blade(width: int, height: int) -> np.ndarray:
    """Corners of an ellipse in the middle of a photo, 60 % of each side across."""
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    return np.column_stack([width * (0.5 + 0.3 * np.cos(angle)), height * (0.5 + 0.3 * np.sin(angle))])


def leaf_with(outline: np.ndarray, base: tuple[float, float], **found) -> Leaf:
    """A leaf of one triangle within the outline, with findings."""
    positions = (outline[:: len(outline) // 3][:3] - base) * (PIXEL, -PIXEL)
    mesh = LeafMesh(
        positions=positions,
        triangles=np.array([[0, 2, 1]], np.int32),
        edges=np.array([[0, 1], [1, 2], [2, 0]], np.int32),
        hinges=np.zeros((0, 4), np.int32),
        edge_areas=np.ones(3),
        vertex_areas=np.full(3, 1e-4),
    )
    findings = Findings(outline=outline, base=base, pixel=PIXEL, **found)
    return Leaf(mesh, MapFrame((0.0, 0.0), (1.0, 1.0)), 0.08, np.zeros((8, 8, 3), np.uint8), findings=findings)


def white_on_black(width: int, height: int) -> Photo:
    picture = np.zeros((height, width, 3), np.uint8)
    cv2.fillPoly(picture, [np.rint(blade(width, height) - 0.5).astype(np.int32)], (255, 255, 255))
    return Photo(Path("drawn.png"), picture, None)


def of_colour(picture: np.ndarray, colour: tuple[int, int, int], tolerance: int = 12) -> np.ndarray:
    return np.abs(picture.astype(int) - colour).max(axis=2) <= tolerance


def picture_part(overlay: np.ndarray) -> np.ndarray:
    """The overlay down to the first row below the photo that is panel and nothing else."""
    empty = of_colour(overlay, PANEL, 0).all(axis=1)
    return overlay[: np.nonzero(empty & (np.arange(len(empty)) > 40))[0][0]]


@pytest.mark.parametrize("size", [(64, 48), (700, 500), (500, 700), (3000, 260), (260, 3000), (4200, 2800)])
def test_size_is_bounded_and_shows_the_photo_upright(size: tuple[int, int]) -> None:
    notes = ("2 leaves seen, the largest is taken: leaf.rect = [x, y, width, height] picks another",) * 3
    overlay = draw_overlay(white_on_black(*size), leaf_with(blade(*size), (size[0] * 0.5, size[1] * 0.8), notes=notes))
    assert overlay.dtype == np.uint8 and overlay.shape[2] == 3
    assert 400 <= max(overlay.shape) <= LONGEST


@pytest.mark.parametrize(("size", "reach_allowed"), [((300, 200), 16.0), ((1900, 2700), 6.0)])
def test_outline_lies_between_leaf_and_background(size: tuple[int, int], reach_allowed: float) -> None:
    """Within half the double line, its antialiasing and, where it is enlarged fivefold, two photo pixels."""
    overlay = draw_overlay(white_on_black(*size), leaf_with(blade(*size), (size[0] * 0.8, size[1] * 0.5)))
    picture = picture_part(overlay)
    line = of_colour(picture, OUTLINE)
    assert np.count_nonzero(line) > 1000
    for side in ((255, 255, 255), (0, 0, 0)):
        reach = cv2.distanceTransform((~of_colour(picture, side)).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        ring = cv2.dilate(of_colour(picture, BASE).astype(np.uint8), np.ones((25, 25))) > 0
        assert reach[line & ~ring].max() <= reach_allowed


def test_ring_is_about_the_base() -> None:
    photo, base = white_on_black(700, 500), (499.5, 249.5)
    cv2.circle(photo.colour, (499, 249), 3, BLUE, -1)
    picture = picture_part(draw_overlay(photo, leaf_with(blade(700, 500), base, base_found="stalk")))
    marker, ring = (np.argwhere(of_colour(picture, colour)) for colour in (BLUE, BASE))
    assert len(ring) > 100
    np.testing.assert_allclose(ring.mean(axis=0), marker.mean(axis=0), atol=2.0)


def test_veins_are_as_wide_as_what_they_drain() -> None:
    points = np.column_stack([np.linspace(250.0, 450.0, 81), np.full(81, 250.0)])
    flow = np.where(np.arange(81) < 40, 1.0, 0.05)
    leaf = leaf_with(blade(700, 500), (350.0, 400.0), veins=((points, flow),))
    picture = picture_part(draw_overlay(white_on_black(700, 500), leaf))
    vein = of_colour(picture, VEIN, 40)
    columns = np.nonzero(vein.any(axis=0))[0]
    ends = columns[[len(columns) // 8, -len(columns) // 8]]
    widths = vein[:, ends].sum(axis=0)
    assert widths[0] >= 2 * widths[1] >= 2
    dark = of_colour(picture, DARK, 60)
    row = int(np.nonzero(vein[:, ends[0]])[0].mean())
    assert dark[row - 8 : row + 9, ends[0]].any()  # so that it shows on a pale leaf


def test_holes_are_outlined() -> None:
    base = (350.0, 400.0)
    leaf = leaf_with(blade(700, 500), base)
    frame = MapFrame((-200 * PIXEL, 0.0), (400 * PIXEL, 300 * PIXEL))  # photo pixels 150 to 550 across, 100 to 400 down
    texture = np.full((150, 200, 4), 255, np.uint8)
    texture[50:80, 120:150, 3] = 0  # photo pixels 390 to 450 across, 200 to 260 down
    picture = picture_part(draw_overlay(white_on_black(700, 500), replace(leaf, frame=frame, texture=texture)))
    plain = picture_part(draw_overlay(white_on_black(700, 500), leaf))
    rows, columns = np.nonzero(of_colour(picture, OUTLINE) & ~of_colour(plain, OUTLINE))
    rim = np.argwhere(of_colour(plain, OUTLINE))
    scale = np.ptp(rim, axis=0) / (300.0, 420.0)  # the ellipse is 420 by 300 photo pixels
    size = np.array([np.ptp(rows), np.ptp(columns)]) / scale
    centre = (np.array([rows.mean(), columns.mean()]) - rim.min(axis=0)) / scale + (100.0, 140.0)
    np.testing.assert_allclose(size, 60.0, atol=4.0)
    np.testing.assert_allclose(centre, (230.0, 420.0), atol=3.0)


def test_holes_of_the_mesh_are_outlined() -> None:
    """A frame of eight triangles: where the photo is white all over, its inner square is drawn as its outer one is."""
    base, outline = (350.0, 250.0), 250.0 + 200.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    outline[:, 0] += 100.0
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    positions = np.concatenate([200.0 * corners, 80.0 * corners]) * PIXEL
    ring = [[i, (i + 1) % 4, 4 + i] for i in range(4)] + [[(i + 1) % 4, 4 + (i + 1) % 4, 4 + i] for i in range(4)]
    leaf = replace(leaf_with(outline, base), mesh=mesh_from_triangles(positions, np.array(ring, np.int32), holes=1))
    photo = Photo(Path("white.png"), np.full((500, 700, 3), 255, np.uint8), None)
    line = of_colour(picture_part(draw_overlay(photo, leaf)), OUTLINE)
    rows, columns = np.nonzero(line)
    outer = np.ptp(columns)
    across = np.nonzero(line[int(rows.mean()) + 60])[0]  # past the ring about the base
    inner = np.ptp(across[(across > columns.min() + 0.1 * outer) & (across < columns.max() - 0.1 * outer)])
    assert inner / outer == pytest.approx(80.0 / 200.0, rel=0.03)


def test_mesh_shows_on_dark_and_on_light_leaves() -> None:
    leaf = leaf_with(blade(700, 500), (350.0, 400.0))
    for shade in (30, 240):
        photo = white_on_black(700, 500)
        np.minimum(photo.colour, shade, out=photo.colour)
        middle = picture_part(draw_overlay(photo, leaf)).astype(int)
        middle = middle[len(middle) // 4 : -len(middle) // 4, middle.shape[1] // 4 : -middle.shape[1] // 4]
        assert np.ptp(middle) > 60  # the mesh's opacity of what black and white differ by


def test_what_is_transparent_shows_as_grey() -> None:
    photo = white_on_black(700, 500)
    alpha = np.where(photo.colour[..., 0] > 0, 255, 0).astype(np.uint8)
    picture = picture_part(draw_overlay(replace(photo, alpha=alpha), leaf_with(blade(700, 500), (350.0, 400.0))))
    assert (picture[60, 60] == CLEAR).all()


def test_notes_and_confidence_stand_below() -> None:
    photo = white_on_black(700, 500)
    plain = draw_overlay(photo, leaf_with(blade(700, 500), (350.0, 400.0)))
    noted = draw_overlay(photo, leaf_with(blade(700, 500), (350.0, 400.0), notes=("the veins do not show",)))
    other = draw_overlay(photo, leaf_with(blade(700, 500), (350.0, 400.0), confidence=0.5))
    assert noted.shape[0] > plain.shape[0]
    assert plain.shape == other.shape and (plain != other).any()


def test_a_leaf_without_findings_is_refused() -> None:
    leaf = replace(leaf_with(blade(70, 50), (35.0, 40.0)), findings=None)
    with pytest.raises(ValueError, match="no findings"):
        draw_overlay(white_on_black(70, 50), leaf)
