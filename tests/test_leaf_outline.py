"""Outline of a silhouette, its holes, and the petiole's end: on drawn leaves of many forms and on real photos."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import real_leaves
from leaf_forms import Drawn, Form, compound, draw, grass, lobed, simple, with_stalk
from leafwarp.leaf.image.photo import Photo, read_photo
from leafwarp.leaf.segment.silhouette import Silhouette, silhouette
from leafwarp.leaf.shape.base_cues import end_breadth, line_directions, mirror_symmetry, tooth_lean, vein_signs
from leafwarp.leaf.shape.outline import Outline, find_outline, trace, trace_holes
from leafwarp.leaf.shape.stalk import find_stalks
from leafwarp.leaf.shape.window import window_around

NEAR = 0.03  # of the leaf's length: what the base may be off by
FORMS = {
    "ovate": simple(),
    "lanceolate": simple(width=0.25, pairs=10),
    "obovate": simple(widest=0.65),
    "serrate": simple(teeth=14, pairs=9),
    "heart": simple(heart=0.22, widest=0.3, width=0.8),
    "broad": simple(width=1.0),
    "steep veins": simple(slant=25.0),
    "lobed": lobed(),
    "seven lobes": lobed(7, 0.5),
    "three lobes": lobed(3),
    "grass": grass(),
}
STALKED = {
    "ovate": with_stalk(FORMS["ovate"]),
    "lobed": with_stalk(FORMS["lobed"]),
    "seven lobes": with_stalk(FORMS["seven lobes"]),
    "lanceolate": with_stalk(FORMS["lanceolate"]),
    "bent": with_stalk(FORMS["ovate"], 0.4, 0.02, bend=2.2),
    "compound": compound(),
    "five pairs": compound(5),
}


def photo_of(drawn: Drawn) -> Photo:
    return Photo(Path("drawn.png"), drawn.picture, None)


def shape_of(cover: np.ndarray) -> Silhouette:
    return Silhouette((2.0 * cover - 1.0).astype(np.float32), (1.0, 1.0))


def outline_of(drawn: Drawn) -> Outline:
    return find_outline(photo_of(drawn), shape_of(drawn.cover))


def crossings(polygon: np.ndarray) -> int:
    """Pairs of a closed polygon's sides, not neighbours, that cross."""
    start, end = polygon, np.roll(polygon, -1, axis=0)
    count = len(polygon)

    def side(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
        way, to = (b - a)[:, None], p[None] - a[:, None]
        return way[..., 0] * to[..., 1] - way[..., 1] * to[..., 0]

    one, two = side(start, end, start), side(start, end, end)
    across = one * two < 0.0
    index = np.arange(count)
    apart = np.abs(index[:, None] - index[None])
    return int(np.count_nonzero(across & across.T & (apart > 1) & (apart < count - 1)) // 2)


@pytest.mark.parametrize("turn", [0.0, 140.0])
@pytest.mark.parametrize("name", FORMS)
def test_base_without_a_stalk(name: str, turn: float) -> None:
    drawn = draw(FORMS[name], turn)
    outline = outline_of(drawn)
    assert np.linalg.norm(outline.base - drawn.base) < (0.05 if name == "obovate" else NEAR) * drawn.length
    assert outline.base_found == "veins"


@pytest.mark.parametrize("veins", [True, False])
@pytest.mark.parametrize("name", STALKED)
def test_base_at_the_end_of_a_stalk(name: str, veins: bool) -> None:
    drawn = draw(STALKED[name], 75.0, mirror=True, veins=veins)
    outline = outline_of(drawn)
    assert np.linalg.norm(outline.base - drawn.base) < 0.015 * drawn.length
    assert outline.base_found == "stalk"


@pytest.mark.parametrize("name", ["ovate", "lanceolate", "serrate", "heart", "grass"])
def test_base_without_veins_is_the_broader_end_of_the_axis(name: str) -> None:
    drawn = draw(FORMS[name], 200.0, veins=False)
    assert np.linalg.norm(outline_of(drawn).base - drawn.base) < NEAR * drawn.length


def test_stub_of_a_petiole_is_taken_to_its_end() -> None:
    drawn = draw(with_stalk(simple(), 0.06, 0.04), 20.0)
    assert np.linalg.norm(outline_of(drawn).base - drawn.base) < NEAR * drawn.length


@pytest.mark.parametrize("turn", [20.0, 70.0])
def test_a_stub_is_a_stalk_from_a_fiftieth_of_the_blade_on(turn: float) -> None:
    """Shorter ones are as the tip of any margin: the base is where the blade begins."""
    for length, how in ((0.02, "veins"), (0.0215, "stalk")):
        drawn = draw(with_stalk(simple(), length, 0.012), turn)
        outline = outline_of(drawn)
        short_of_its_end = np.linalg.norm(outline.base - drawn.base) / (length * drawn.length)
        assert outline.base_found == how
        assert short_of_its_end > 0.8 if how == "veins" else short_of_its_end < 0.2


def test_blade_cut_by_the_border_starts_at_the_middle_of_the_cut() -> None:
    drawn = draw(grass(), 0.0, pixels=600.0)
    kept = int(drawn.base[1]) - 30
    photo = Photo(Path("drawn.png"), drawn.picture[:kept].copy(), None)
    outline = find_outline(photo, shape_of(drawn.cover[:kept]))
    assert np.linalg.norm(outline.base - (drawn.base[0], kept)) < 0.01 * drawn.length


def test_sliver_along_the_margin_is_no_petiole() -> None:
    """A shadow's rim that was taken for leaf, as slender as a stalk."""
    drawn = draw(simple(teeth=14, width=0.8), 0.0)
    sliver = np.zeros(drawn.cover.shape, np.uint8)
    cv2.polylines(sliver, [np.array([[62, 290], [38, 230], [50, 170], [75, 120]])], False, 1, 5)
    outline = find_outline(photo_of(drawn), shape_of(np.maximum(drawn.cover, sliver)))
    assert np.linalg.norm(outline.base - drawn.base) < NEAR * drawn.length


def test_given_base_is_taken_to_the_outline() -> None:
    drawn = draw(simple())
    outline = find_outline(photo_of(drawn), shape_of(drawn.cover), base=(drawn.base[0] + 60.0, drawn.base[1] - 100.0))
    assert outline.base_found == "given"
    assert (outline.points == outline.base).all(axis=1).any()
    assert np.linalg.norm(outline.base - drawn.base) > 0.1 * drawn.length


@pytest.mark.parametrize("form", [*FORMS.values(), *STALKED.values()], ids=[*FORMS, *(f"{n} stalked" for n in STALKED)])
def test_outline_is_a_simple_polygon_of_the_right_area(form: Form) -> None:
    drawn = draw(form, 33.0, pixels=160.0)
    points = trace(shape_of(drawn.cover))
    assert crossings(points) == 0
    x, y = points.T
    area = 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    assert area == pytest.approx(drawn.cover.sum(), rel=0.02)  # corners are rounded by about a pixel


@pytest.mark.parametrize("width", [1, 2, 3])
@pytest.mark.parametrize("way", [(0, 1), (1, 1), (2, 1)])
def test_thin_petiole_is_kept(width: int, way: tuple[int, int]) -> None:
    field = np.full((160, 120), -1.0, np.float32)
    cv2.circle(field, (60, 40), 30, 1.0, -1)
    end = (60 + 20 * way[0], 65 + 40 * way[1])
    cv2.line(field, (60, 65), end, 0.3, width, cv2.LINE_4)
    outline = find_outline(Photo(Path("x"), np.full((160, 120, 3), 90, np.uint8), None), Silhouette(field, (1.0, 1.0)))
    assert np.linalg.norm(outline.base - np.add(end, 0.5)) < 2.5
    assert crossings(outline.points) == 0


def test_ragged_shapes_give_simple_polygons() -> None:
    random = np.random.default_rng(3)
    for _ in range(6):
        noise = cv2.GaussianBlur(random.normal(size=(60, 60)), (0, 0), 2.2)
        y, x = np.mgrid[-1.0:1.0:60j, -1.0:1.0:60j]
        inside = (noise / noise.std() + 3.0 * (0.6 - np.hypot(x, y)) > 0.0).astype(np.uint8)
        _, labels, boxes, _ = cv2.connectedComponentsWithStats(inside, connectivity=4)
        largest = labels == 1 + np.argmax(boxes[1:, 4])
        assert crossings(trace(shape_of(largest.astype(float)))) == 0


def test_holes_are_traced_inside_the_outline() -> None:
    field = np.full((120, 160), -1.0, np.float32)
    cv2.ellipse(field, (80, 60), (70, 50), 0, 0, 360, 1.0, -1)
    holes = np.zeros(field.shape, np.uint8)
    cv2.ellipse(holes, (60, 60), (14, 9), 0, 0, 360, 1, -1)
    cv2.circle(holes, (110, 50), 5, 1, -1)
    cv2.circle(holes, (80, 108), 6, 1, -1)  # it touches the margin: what is left of it stays off the outline
    holes[30, 80] = 1  # a single pixel has no shape
    shape = Silhouette(field, (2.0, 2.0), holes > 0)
    outline, traced = trace(shape), trace_holes(shape)
    assert len(traced) == 3
    pieces = cv2.connectedComponents(holes)[1]
    for polygon, centre in zip(traced, [(60.5, 60.5), (110.5, 50.5)], strict=False):
        x, y = polygon.T / 2.0
        area = np.count_nonzero(pieces == pieces[int(centre[1]), int(centre[0])])
        assert 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) == pytest.approx(area, rel=0.12)
        np.testing.assert_allclose(polygon.mean(axis=0) / 2.0, centre, atol=0.3)
    for polygon in traced:
        assert crossings(polygon) == 0
        margin = [cv2.pointPolygonTest(outline.astype(np.float32), point.tolist(), True) for point in polygon]
        assert min(margin) > 1.0  # [photo pixels], half a pixel of the silhouette
    assert trace_holes(Silhouette(field, (2.0, 2.0))) == ()


def test_tips_and_rachis_are_no_stalks() -> None:
    tapering = trace(shape_of(draw(simple(widest=0.25, width=0.3), 10.0).cover))
    assert find_stalks(window_around(tapering, 70_000)) == []
    drawn = draw(compound(), 50.0)
    stalks = find_stalks(window_around(trace(shape_of(drawn.cover)), 70_000))
    slender = [stalk for stalk in stalks if stalk.slenderness > 4.0]
    assert len(slender) == 1 and np.linalg.norm(slender[0].end - drawn.base) < 0.02 * drawn.length


@pytest.mark.parametrize("degrees", [0.0, 30.0, 80.0, 135.0])
def test_line_directions_of_a_grating(degrees: float) -> None:
    y, x = np.mgrid[0:120, 0:120] + 0.5
    angle = np.deg2rad(degrees)
    wave = 110.0 + 40.0 * np.sin(0.5 * (y * np.cos(angle) - x * np.sin(angle)))
    colours = np.repeat(wave[..., None], 3, axis=2).astype(np.uint8)
    found = line_directions(colours, np.hypot(x - 60.0, y - 60.0) < 55.0)[40:80, 40:80]
    turn = np.angle(found * np.exp(-2j * angle))
    assert np.abs(turn).max() < np.deg2rad(6.0)  # the doubled angle: 3 degrees, as gradients of bytes are
    assert np.abs(found).min() > 0.5


def test_vein_signs_of_exact_fields() -> None:
    y, x = np.mgrid[0:80, 0:60] + 0.5
    inside = np.hypot((x - 30.0) / 25.0, (y - 40.0) / 36.0) < 1.0
    bottom, top = np.array([[30.0, 76.0], [30.0, 4.0]])
    # Side veins that rise towards the top at 50 degrees from the vertical midrib; y runs down.
    slanting = np.where(x > 30.0, np.deg2rad(-40.0), np.deg2rad(-140.0))
    means, _ = vein_signs(np.where(inside, np.exp(2j * slanting), 0.0), np.array([bottom, top]))
    np.testing.assert_allclose(means.imag, np.sin(np.deg2rad(100.0)) * np.array([1.0, -1.0]), atol=0.02)
    radial = np.exp(2j * np.arctan2(y - bottom[1], x - bottom[0]))
    _, radiation = vein_signs(np.where(inside, radial, 0.0), np.array([bottom, top]))
    assert radiation[0] == pytest.approx(1.0) and radiation[1] < 0.5
    faint = vein_signs(np.where(inside, 0.01 * radial, 0.0), np.array([bottom]))[1]
    assert abs(faint[0]) < 0.02  # where nothing shows nothing is said


def test_shape_signs_of_a_serrate_leaf() -> None:
    drawn = draw(simple(teeth=14), 0.0)
    polygon = trace(shape_of(drawn.cover))
    inside = drawn.cover > 0.5
    ends = np.array([drawn.base, polygon[np.argmin(polygon[:, 1])], polygon[np.argmin(polygon[:, 0])]])
    leans = tooth_lean(polygon, ends)
    assert leans[0] > 0.2 and leans[1] < -0.2
    breadth, slenderness = end_breadth(inside, ends)
    assert breadth[0] > 0.0 > breadth[1] and slenderness[0] > 1.2 > slenderness[2]
    symmetry = mirror_symmetry(inside, ends)
    assert symmetry[0] > 0.97 and symmetry[1] > 0.97 and symmetry[2] < symmetry[0]


@pytest.mark.parametrize("name", real_leaves.BASES)
def test_base_of_real_leaves(name: str) -> None:
    if name not in real_leaves.present():
        pytest.skip("the photo is not beside the repository")
    photo = read_photo(real_leaves.FOLDER / f"{name}.jpg")
    outline = find_outline(photo, silhouette(photo))
    assert np.linalg.norm(outline.base - real_leaves.BASES[name]) < NEAR * outline.length
