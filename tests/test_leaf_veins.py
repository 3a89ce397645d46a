"""Veins: the drawn ones are found, the tree drains all of the leaf, and what is made up fits the outline."""

from __future__ import annotations

import importlib
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from leaf_pictures import LAMINA, draw_leaf, vein_lines, write_image
from leafwarp.errors import InputError
from leafwarp.leaf.image.photo import Photo, read_photo
from leafwarp.leaf.segment.silhouette import silhouette
from leafwarp.leaf.shape.outline import Outline, find_outline
from leafwarp.leaf.venation.drainage import accumulate, vein_tree
from leafwarp.leaf.venation.shape import LeafShape, is_blade, lobe_tips, suits_palmate
from leafwarp.leaf.venation.veins import Branch, Venation, drainage, find_veins, find_venation, vein_likelihood

PIXEL = 1.0  # [pixels] a smoothed branch leaves the outline by at most, besides the raster's own pixel
SCENES = Path(__file__).parent.parent / "scenes"


def prepared(folder: Path, pixels: np.ndarray) -> tuple[Photo, Outline]:
    photo = read_photo(write_image(folder / "leaf.png", pixels))
    return photo, find_outline(photo, silhouette(photo))


@pytest.fixture(scope="module")
def leaf(tmp_path_factory: pytest.TempPathFactory) -> tuple[Photo, Outline]:
    return prepared(tmp_path_factory.mktemp("veins"), draw_leaf(teeth=40, depth=0.06))


@pytest.fixture(scope="module")
def bare_leaf(tmp_path_factory: pytest.TempPathFactory) -> tuple[Photo, Outline]:
    return prepared(tmp_path_factory.mktemp("bare"), draw_leaf(teeth=40, depth=0.06, veins=False))


def drawn_outline(points: np.ndarray, base: tuple[float, float], petiole_width: float = 8.0) -> tuple[Photo, Outline]:
    """A plain photo of a polygon and the polygon as its outline."""
    points = np.asarray(points, float)
    corners = [
        start + np.linspace(0.0, 1.0, max(2, int(np.linalg.norm(end - start))), endpoint=False)[:, None] * (end - start)
        for start, end in pairwise([*points, points[0]])
    ]
    points = np.concatenate(corners)
    start = points[np.argmin(np.linalg.norm(points - base, axis=1))]
    tip = points[np.argmax(np.linalg.norm(points - start, axis=1))]
    size = np.ceil(points.max(axis=0)).astype(int) + 20
    picture = np.empty((size[1], size[0], 3), np.uint8)
    picture[:] = LAMINA
    return Photo(Path("drawn.png"), picture, None), Outline(points, start, tip, petiole_width)


def strip(line: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Polygon around a line with the given width at each of its points."""
    tangent = np.gradient(line, axis=0)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) / np.linalg.norm(tangent, axis=1)[:, None]
    return np.concatenate([line + 0.5 * widths[:, None] * normal, (line - 0.5 * widths[:, None] * normal)[::-1]])


def union(*polygons: np.ndarray) -> np.ndarray:
    """Outline of overlapping polygons."""
    canvas = np.zeros((900, 900), np.uint8)
    for polygon in polygons:
        cv2.fillPoly(canvas, [np.rint(polygon).astype(np.int32)], 1)
    contours, _ = cv2.findContours(canvas, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return max(contours, key=cv2.contourArea)[:, 0].astype(float) + 0.5


def ellipse(centre: tuple[float, float], axes: tuple[float, float], degrees: float) -> np.ndarray:
    angle, turn = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False), np.radians(degrees)
    x, y = axes[0] * np.cos(angle), axes[1] * np.sin(angle)
    return np.column_stack([x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn)]) + centre


def compound_leaf() -> np.ndarray:
    """Five leaflets on a thin rachis, neighbours a few pixels apart."""
    leaflets = [ellipse((400.0, 130.0), (62.0, 105.0), 0.0)]
    stalks = [strip(np.array([[400.0, 860.0], [400.0, 500.0], [400.0, 180.0]]), np.full(3, 9.0))]
    for height, reach in ((330.0, 190.0), (560.0, 200.0)):
        for side in (-1.0, 1.0):
            leaflets.append(ellipse((400.0 + side * reach, height), (140.0, 88.0), 0.0))
            stalks.append(strip(np.array([[400.0, height], [400.0 + 0.5 * side * reach, height]]), np.full(2, 7.0)))
    return union(*leaflets, *stalks)


def blade_polygon(bend: float = 60.0) -> np.ndarray:
    share = np.linspace(0.0, 1.0, 300)
    line = np.column_stack([100.0 + bend * share**2, 820.0 - 780.0 * share])
    return strip(line, 70.0 * np.clip(np.sin(np.pi * (0.12 + 0.88 * share)) ** 0.6, 0.01, 1.0))


def dense(lines: list[np.ndarray]) -> np.ndarray:
    """Points about a pixel apart along polylines."""
    points = []
    for line in lines:
        arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        at = np.arange(0.0, arc[-1])
        points.append(np.column_stack([np.interp(at, arc, line[:, axis]) for axis in (0, 1)]))
    return np.concatenate(points)


def depths(outline: Outline, branches: list[Branch]) -> np.ndarray:
    """Signed distance of all the branches' points from the outline, positive inside."""
    contour = outline.points.astype(np.float32)
    return np.array([cv2.pointPolygonTest(contour, tuple(map(float, p)), True) for b in branches for p in b.points])


def check_tree(venation: Venation, outline: Outline) -> None:
    """One tree that starts at the base, feeds all of the leaf and thins outwards, inside the outline."""
    branches = venation.branches
    reach = 0.012 * outline.length  # a raster pixel of the search, and its smoothing
    assert np.linalg.norm(branches[0].points[0] - outline.base) < reach + outline.petiole_width
    assert branches[0].flow[0] == pytest.approx(1.0, abs=0.01)
    for branch in branches:
        assert (np.diff(branch.flow) <= 1e-12).all() and (branch.flow > 0.0).all()
    for index, branch in enumerate(branches[1:], start=1):
        others = np.concatenate([other.points for other in branches[:index]])
        larger = np.concatenate([other.flow for other in branches[:index]])
        distance = np.linalg.norm(others - branch.points[0], axis=1)
        joined = distance < reach
        assert joined.any(), f"branch {index} starts {distance.min():.1f} pixels from every larger one"
        assert larger[joined].max() >= branch.flow[0] - 1e-12
    assert np.quantile(depths(outline, branches), 0.002) > -reach


def f_score(venation: Venation, drawn: np.ndarray, tolerance: float, least_flow: float) -> float:
    """Harmonic mean of the shares of the found and of the drawn veins that have the other within a tolerance."""
    main = [branch.points[branch.flow > least_flow] for branch in venation.branches]
    found = dense([line for line in main if len(line) > 1])
    precision = (cKDTree(drawn).query(found)[0] < tolerance).mean()
    recall = (cKDTree(found).query(drawn)[0] < tolerance).mean()
    return 2.0 * precision * recall / (precision + recall)


def test_drawn_veins_are_found(leaf: tuple[Photo, Outline]) -> None:
    photo, outline = leaf
    venation = find_venation(photo, outline)
    assert venation.kind == "photo" and venation.contrast > 10.0
    check_tree(venation, outline)
    assert f_score(venation, dense(vein_lines()), 0.01 * outline.length, 0.003) > 0.97  # measured 0.997


@pytest.mark.parametrize(("name", "least"), [("bramble", 0.85), ("still", 0.85), ("cut", 0.75)])
def test_veins_of_the_scenes_leaves_are_found(name: str, least: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Against the curves that the pictures were drawn from: midribs and secondaries under a network of fine veins."""
    monkeypatch.syspath_prepend(str(SCENES))
    catalogue, leaves = (importlib.import_module(f"drawing.{module}") for module in ("catalogue", "leaves"))
    shape = getattr(catalogue, name.upper()).shape
    fields = leaves.LeafFields(shape)
    drawn = dense([shape.placement.to_picture(vein.points) for vein in fields.venation.veins if vein.order < 2])
    photo = read_photo(SCENES / f"{name}.png")
    outline = find_outline(photo, silhouette(photo))
    venation = find_venation(photo, outline)
    assert venation.kind == "photo" and venation.contrast > 5.0
    assert f_score(venation, drawn, 0.01 * outline.length, 0.005) > least  # measured 0.91, 0.92, 0.82


@pytest.mark.parametrize("noise", [0.0, 6.0])
def test_every_pixel_drains_to_the_base_and_nothing_is_lost(leaf: tuple[Photo, Outline], noise: float) -> None:
    photo, outline = leaf
    inside = np.zeros(photo.size[::-1], np.uint8)
    cv2.fillPoly(inside, [np.rint(outline.points - 0.5).astype(np.int32)], 1)
    inside = cv2.resize(inside, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) > 0
    colour = cv2.resize(photo.colour, inside.shape[::-1], interpolation=cv2.INTER_AREA)
    colour = np.clip(colour + np.random.default_rng(3).normal(0.0, noise, colour.shape), 0, 255).astype(np.uint8)
    rows, columns, cost, predecessor = drainage(vein_likelihood(colour, inside), inside, 0.5 * outline.base)
    assert len(rows) == inside.sum() and np.isfinite(cost).all()
    assert (predecessor < 0).sum() == 1
    steps = np.hypot(rows - rows[predecessor], columns - columns[predecessor])[predecessor >= 0]
    assert steps.max() < 1.5  # a tree of neighbours
    count = len(rows)
    flow = accumulate(cost, predecessor) * count
    fed = np.bincount(predecessor[predecessor >= 0], weights=flow[predecessor >= 0], minlength=count)
    np.testing.assert_allclose(flow - fed, 1.0, atol=1e-9 * count)  # each adds its own unit
    assert flow[predecessor < 0] == pytest.approx(count)


def test_veins_that_do_not_show_are_made_up(bare_leaf: tuple[Photo, Outline]) -> None:
    photo, outline = bare_leaf
    venation = find_venation(photo, outline)
    assert venation.kind == "pinnate" and venation.contrast < 2.1
    check_tree(venation, outline)
    assert find_venation(photo, outline, "photo").kind == "photo"


@pytest.mark.parametrize("kind", ["pinnate", "palmate", "parallel"])
def test_made_up_veins_fit_and_repeat(bare_leaf: tuple[Photo, Outline], kind: str) -> None:
    photo, outline = bare_leaf
    venation = find_venation(photo, outline, kind)
    assert venation.kind == kind and venation.contrast is None
    check_tree(venation, outline)
    again = find_veins(photo, outline, kind)
    assert all(np.array_equal(a.points, b.points) for a, b in zip(venation.branches, again, strict=True))
    # No part of the lamina is far from a vein.
    inside = np.zeros(photo.size[::-1], np.uint8)
    cv2.fillPoly(inside, [np.rint(outline.points - 0.5).astype(np.int32)], 1)
    rows, columns = np.nonzero(inside)
    away = cKDTree(dense([branch.points for branch in venation.branches])).query(np.column_stack([columns, rows]))[0]
    assert np.quantile(away, 0.98) < 0.08 * outline.length


def test_made_up_veins_follow_the_seed(bare_leaf: tuple[Photo, Outline]) -> None:
    first, second = (find_veins(*bare_leaf, "pinnate", seed=seed) for seed in (0, 1))
    assert len(first) != len(second) or any(
        a.points.shape != b.points.shape for a, b in zip(first, second, strict=True)
    )


def test_midrib_of_a_pinnate_leaf_runs_to_its_tip(bare_leaf: tuple[Photo, Outline]) -> None:
    photo, outline = bare_leaf
    rib = find_veins(photo, outline, "pinnate")[0]
    assert np.linalg.norm(rib.points[-1] - outline.tip) < 0.1 * outline.length
    assert np.abs(rib.points[:, 0] - 212.0).max() < 0.05 * outline.length  # drawn upright, its axis at x = 210 to 216
    sides = [branch for branch in find_veins(photo, outline, "pinnate")[1:] if branch.flow[0] > 0.01]
    assert len(sides) >= 8
    lean = [branch.points[0, 1] - branch.points[len(branch.points) // 2, 1] for branch in sides]
    assert np.mean(np.array(lean) > 0.0) > 0.8  # side veins lean towards the tip, which is up


def test_lobes_get_a_main_vein_each() -> None:
    lobes = [ellipse((450.0 + 190.0 * np.sin(a), 470.0 - 190.0 * np.cos(a)), (70.0, 200.0), np.degrees(a))
             for a in np.radians([-100.0, -50.0, 0.0, 50.0, 100.0])]  # fmt: skip
    stalk = strip(np.array([[450.0, 880.0], [450.0, 480.0]]), np.full(2, 10.0))
    photo, outline = drawn_outline(union(*lobes, stalk), (450.0, 880.0))
    venation = find_venation(photo, outline)
    assert venation.kind == "palmate"
    check_tree(venation, outline)
    ends = np.concatenate([branch.points[branch.flow > 0.004] for branch in venation.branches])
    for angle in np.radians([-100.0, -50.0, 0.0, 50.0, 100.0]):
        tip = np.array([450.0 + 370.0 * np.sin(angle), 470.0 - 370.0 * np.cos(angle)])
        assert np.linalg.norm(ends - tip, axis=1).min() < 60.0, angle


@pytest.mark.parametrize("kind", ["auto", "photo", "pinnate", "palmate"])
def test_compound_leaf_drains_through_its_stalks(kind: str) -> None:
    photo, outline = drawn_outline(compound_leaf(), (400.0, 860.0))
    venation = find_venation(photo, outline, kind)
    check_tree(venation, outline)
    deep = depths(outline, venation.branches)
    assert deep.min() > -3.0 - PIXEL, "a vein crosses the gap between leaflets"
    rachis = [b for b in venation.branches if b.flow[0] > 0.99]
    at = np.argmin(np.abs(rachis[0].points[:, 1] - 700.0))
    assert rachis[0].flow[at] > 0.9 and abs(rachis[0].points[at, 0] - 400.0) < 6.0  # all the leaflets' water


def test_blade_gets_parallel_veins() -> None:
    photo, outline = drawn_outline(blade_polygon(), (100.0, 820.0))
    venation = find_venation(photo, outline)
    assert venation.kind == "parallel"
    check_tree(venation, outline)
    for height in (300.0, 450.0, 600.0):
        crossings, flows = [], []
        for branch in venation.branches:
            x, y = branch.points.T
            across = np.nonzero((y[:-1] - height) * (y[1:] - height) <= 0.0)[0]
            crossings += x[across].tolist()
            flows += branch.flow[across].tolist()
        crossings = np.sort(np.array(crossings)[np.array(flows) > 0.004])
        gaps = np.diff(crossings)
        assert 5 <= len(crossings) <= 17 and gaps.std() < 0.3 * gaps.mean(), crossings
        assert max(flows) < 0.6  # shared among the veins


def test_blade_of_the_scene_gets_parallel_veins() -> None:
    photo = read_photo(SCENES / "blade.png")
    outline = find_outline(photo, silhouette(photo))
    venation = find_venation(photo, outline)
    assert venation.kind == "parallel"
    check_tree(venation, outline)


@pytest.mark.parametrize(("degrees", "kind"), [(0.0, "parallel"), (50.0, "photo")])
def test_stripes_along_a_broad_leaf_are_parallel_veins(degrees: float, kind: str) -> None:
    """A piece of a corn leaf is not six times as long as wide, but striped; stripes across are something else."""
    photo, outline = drawn_outline(
        np.array([[20.0, 20.0], [320.0, 20.0], [320.0, 520.0], [20.0, 520.0]]), (170.0, 520.0)
    )
    turn = np.radians(degrees)
    y, x = np.mgrid[: photo.size[1], : photo.size[0]]
    stripes = 25.0 * np.sin(0.5 * (x * np.cos(turn) + y * np.sin(turn)))[..., None]
    noise = np.random.default_rng(2).normal(0.0, 8.0, stripes.shape)
    picture = np.clip(photo.colour + stripes + noise, 0, 255).astype(np.uint8)
    assert find_venation(Photo(photo.path, picture, None), outline).kind == kind


@pytest.mark.parametrize(
    ("polygon", "base", "blade", "palmate"),
    [
        (blade_polygon(), (100.0, 820.0), True, False),
        (blade_polygon(bend=300.0), (100.0, 820.0), True, False),
        (compound_leaf(), (400.0, 860.0), False, False),
        (ellipse((400.0, 300.0), (80.0, 200.0), 0.0), (400.0, 500.0), False, False),
        (ellipse((400.0, 300.0), (210.0, 200.0), 0.0), (400.0, 500.0), False, True),
        (
            union(ellipse((300.0, 200.0), (60.0, 99.0), 0.0), strip(np.array([[300, 290], [300, 880]]), np.full(2, 9))),
            (300, 880),
            False,
            False,
        ),
    ],
    ids=["blade", "bent blade", "compound", "oval", "round", "long stalk"],
)  # fmt: skip
def test_what_the_outline_says(polygon: np.ndarray, base: tuple, blade: bool, palmate: bool) -> None:
    low = polygon.min(axis=0) - 4.0
    polygon, base = polygon - low, np.subtract(base, low)
    size = np.ceil(polygon.max(axis=0)).astype(int) + 4
    inside = np.zeros(size[::-1], np.uint8)
    cv2.fillPoly(inside, [np.rint(polygon - 0.5).astype(np.int32)], 1)
    tip = polygon[np.argmax(np.linalg.norm(polygon - base, axis=1))]
    shape = LeafShape.of(inside > 0, polygon, base, tip)
    assert is_blade(shape) == blade
    if not blade:
        assert suits_palmate(shape) == palmate or len(lobe_tips(shape)) >= 3


def test_true_holes_carry_no_veins(bare_leaf: tuple[Photo, Outline]) -> None:
    photo, outline = bare_leaf
    hole = ellipse((240.0, 250.0), (40.0, 60.0), 0.0)
    holed = Outline(outline.points, outline.base, outline.tip, outline.petiole_width, (hole,))
    for kind in ("photo", "pinnate"):
        points = np.concatenate([branch.points for branch in find_veins(photo, holed, kind)])
        contour = hole.astype(np.float32)
        deepest = max(cv2.pointPolygonTest(contour, tuple(map(float, point)), True) for point in points)
        assert deepest < 4.0  # the raster and the smoothing of a path around a corner


def test_tree_of_a_flat_picture_is_whole() -> None:
    inside = np.ones((30, 40), bool)
    branches = vein_tree(np.zeros((30, 40)), inside, np.array([20.0, 30.0]))
    assert branches[0].flow[0] == pytest.approx(1.0) and np.linalg.norm(branches[0].points[0] - (20.0, 30.0)) < 1.0


def test_unknown_kind_is_refused(leaf: tuple[Photo, Outline]) -> None:
    with pytest.raises(InputError, match=r"leaf\.png: maps: venation: 'fern' is not accepted; accepted: auto, photo"):
        find_veins(*leaf, "fern")
