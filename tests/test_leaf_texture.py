"""The texture: where its texels lie, what is past the margin, its size, and the opacity of holes down to the USD."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import UsdShade

from leaf_pictures import LAMINA, TIP, blade_outline, coverage, draw_leaf
from leafwarp.leaf.bleed import extend_colours
from leafwarp.leaf.image.photo import Photo
from leafwarp.leaf.maps.make import PixelFrame
from leafwarp.leaf.segment.silhouette import Silhouette
from leafwarp.leaf.shape.outline import Outline
from leafwarp.leaf.texture import make_texture
from leafwarp.png import encode_png
from leafwarp.usd.check import check_usd
from usd_sample import open_afresh, sample_leaf, write_sample

HOLE_CENTRE, HOLE_RADIUS = np.array([250.0, 180.0]), 24.0  # [pixels]
DOT, DOT_COLOUR = (160, 300), (220, 40, 160)  # a corner of the leaf without symmetry


def circle(centre: np.ndarray, radius: float) -> np.ndarray:
    angle = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    return centre + radius * np.column_stack([np.cos(angle), np.sin(angle)])


def hole() -> np.ndarray:
    return circle(HOLE_CENTRE, HOLE_RADIUS)


@pytest.fixture(scope="module")
def photo() -> Photo:
    """A leaf without petiole with a hole that shows white paper, and a dot."""
    picture = draw_leaf(petiole=False, veins=False)
    share = coverage(hole())[..., None]
    picture = np.rint(picture * (1.0 - share) + 255.0 * share).astype(np.uint8)
    picture[DOT[1] - 4 : DOT[1] + 4, DOT[0] - 4 : DOT[0] + 4] = DOT_COLOUR
    return Photo(Path("drawn.png"), picture, None)


@pytest.fixture(scope="module")
def shape() -> Silhouette:
    return Silhouette(np.float32(2.0 * coverage(blade_outline()) - 1.0), (1.0, 1.0))


def outline(*holes: np.ndarray) -> Outline:
    return Outline(blade_outline(), np.array([210.0, 420.0]), np.array(TIP), 9.0, holes=holes)


def uv_of(frame: PixelFrame, point: tuple[float, float]) -> np.ndarray:
    """Texture coordinates of a photo point, v upward."""
    across, down = np.subtract(point, (frame.left, frame.top)) / frame.size
    return np.array([across, 1.0 - down])


def dot_uv(texture: np.ndarray) -> np.ndarray:
    rows, columns = np.nonzero((texture[..., 0] > 150) & (texture[..., 1] < 90))
    assert len(rows)
    return np.array([(columns.mean() + 0.5) / texture.shape[1], 1.0 - (rows.mean() + 0.5) / texture.shape[0]])


@pytest.mark.parametrize("limit", [None, 1000, 200])
def test_a_dot_keeps_its_place_at_every_size(photo: Photo, shape: Silhouette, limit: int | None) -> None:
    frame = PixelFrame.around(outline())
    texture = make_texture(photo, shape, outline(), frame, limit)
    assert (
        texture.shape[:2][::-1] == frame.size
        if limit is None or limit > max(frame.size)
        else max(texture.shape) == limit
    )
    assert texture.shape[1] / texture.shape[0] == pytest.approx(frame.size[0] / frame.size[1], rel=0.01)
    np.testing.assert_allclose(dot_uv(texture), uv_of(frame, DOT), atol=0.6 / min(texture.shape[:2]))


def test_a_smaller_texture_holds_area_means(photo: Photo, shape: Silhouette) -> None:
    """The leaf's grain has a mean of zero: averaged down by three it loses two thirds of its deviation."""
    frame = PixelFrame.around(outline())
    full, small = (make_texture(photo, shape, outline(), frame, limit) for limit in (None, max(frame.size) // 3))
    middle = [
        texture[int(0.6 * len(texture)) : int(0.7 * len(texture)), texture.shape[1] // 2 :][:, :20, 0]
        for texture in (full, small)
    ]
    assert middle[1].mean() == pytest.approx(middle[0].mean(), abs=0.7)
    assert middle[1].std() < 0.6 * middle[0].std()


@pytest.mark.parametrize("limit", [None, 200])
def test_no_background_past_the_margin_or_in_holes(photo: Photo, shape: Silhouette, limit: int | None) -> None:
    frame = PixelFrame.around(outline(hole()))
    texture = make_texture(photo, shape, outline(hole()), frame, limit)
    dot = (texture[..., 0] > 150) & (texture[..., 1] < 90)
    near_dot = cv2.dilate(dot.astype(np.uint8), np.ones((7, 7))) > 0
    away = np.abs(texture[..., :3].astype(int) - LAMINA).max(axis=2)
    assert away[~near_dot].max() < 25  # grain of 1.5, a soft shadow and the camera's slope, far from paper at 180


def test_holes_are_transparent_and_nothing_else(photo: Photo, shape: Silhouette) -> None:
    frame = PixelFrame.around(outline(hole()))
    texture = make_texture(photo, shape, outline(hole()), frame)
    assert texture.shape[2] == 4
    rows, columns = np.indices(texture.shape[:2])
    away = np.hypot(columns + 0.5 + frame.left - HOLE_CENTRE[0], rows + 0.5 + frame.top - HOLE_CENTRE[1])
    assert (texture[away < HOLE_RADIUS - 1.0, 3] == 0).all()
    assert (texture[away > HOLE_RADIUS + 1.0, 3] == 255).all()
    area = (255 - texture[..., 3].astype(float)).sum() / 255.0
    assert area == pytest.approx(np.pi * HOLE_RADIUS**2, rel=0.03)
    assert make_texture(photo, shape, outline(hole()), frame, cut_holes=False).shape[2] == 3
    assert make_texture(photo, shape, outline(), frame).shape[2] == 3


def test_extended_colours_are_those_of_the_nearest_pixel() -> None:
    random = np.random.default_rng(5)
    inside = random.random((40, 30)) < 0.05
    colour = random.integers(0, 256, (40, 30, 3)).astype(np.uint8)
    extended = extend_colours(colour, inside)
    np.testing.assert_array_equal(extended[inside], colour[inside])
    places = np.argwhere(inside)
    for row, column in np.argwhere(~inside)[::37]:
        distance = np.hypot(*(places - (row, column)).T)
        # The distances of the 5 x 5 mask are good to about 2 %.
        near = places[distance <= 1.03 * distance.min()]
        assert (colour[near[:, 0], near[:, 1]] == extended[row, column]).all(axis=1).any()


def surface_of(path: Path) -> UsdShade.Shader:
    stage = open_afresh(path)
    material = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/Leaf/geo/leaf")).ComputeBoundMaterial()[0]
    surface = material.ComputeSurfaceSource()[0]
    surface.stage = stage  # a shader does not keep its stage alive
    return surface


def test_opacity_reaches_the_usd_and_only_where_there_is_one(tmp_path: Path) -> None:
    plain = sample_leaf()
    alpha = np.full(plain.texture.shape[:2], 255, np.uint8)
    alpha[3:6, 2:5] = 0
    holed = replace(plain, texture=np.dstack([plain.texture, alpha]))
    surface = surface_of(write_sample(tmp_path / "holed.usda", leaf=holed))
    source = surface.GetInput("opacity").GetConnectedSources()[0][0]
    assert UsdShade.Shader(source.source.GetPrim()).GetShaderId() == "UsdUVTexture" and source.sourceName == "a"
    assert surface.GetInput("opacityThreshold").Get() == 0.5
    stored = cv2.imread(str(tmp_path / "holed_texture.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(cv2.cvtColor(stored, cv2.COLOR_BGRA2RGBA), holed.texture)
    assert check_usd(tmp_path / "holed.usda") == []

    surface = surface_of(write_sample(tmp_path / "plain.usda", leaf=plain))
    assert not surface.GetInput("opacity") and not surface.GetInput("opacityThreshold")


def test_png_of_no_picture_is_refused() -> None:
    with pytest.raises(ValueError, match=r"float64 given; accepted: .*uint8"):
        encode_png(np.zeros((4, 4, 3)))
    with pytest.raises(ValueError, match=r"shape \(4, 4, 2\)"):
        encode_png(np.zeros((4, 4, 2), np.uint8))
