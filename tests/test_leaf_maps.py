"""Maps: alignment, connectivity at every size, the source's sum, and veins where the picture shows them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from leaf_pictures import BASE, HEIGHT, TIP, WIDTH, coverage, draw_leaf, vein_lines, write_image
from leafwarp.errors import InputError
from leafwarp.leaf.maps import PixelFrame, interval_means, leaf_cells, make_maps
from leafwarp.leaf.outline import Outline, find_outline
from leafwarp.leaf.photo import Photo, read_photo
from leafwarp.leaf.segment import silhouette

SIZES = [
    (8, 8),
    (16, 200),
    (200, 16),
    (1, 64),
    (64, 1),
    (1, 1),
    (2, 2),
    (37, 91),
    (256, 256),
    (1024, 1024),
    (512, 64),
]


@pytest.fixture(scope="module")
def leaf(tmp_path_factory: pytest.TempPathFactory) -> tuple[Photo, Outline, PixelFrame]:
    photo = read_photo(write_image(tmp_path_factory.mktemp("maps") / "leaf.png", draw_leaf(teeth=40, depth=0.06)))
    outline = find_outline(photo, silhouette(photo))
    return photo, outline, PixelFrame.around(outline)


def photo_points(frame: PixelFrame, map_size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Photo x and y of the cell centres, shape [ny, nx] each."""
    x = frame.left + (np.arange(map_size[0]) + 0.5) * frame.size[0] / map_size[0]
    y = frame.bottom - (np.arange(map_size[1]) + 0.5) * frame.size[1] / map_size[1]
    return np.meshgrid(x, y)


@pytest.mark.parametrize("map_size", SIZES)
def test_mask_is_one_region_with_base_and_tip(leaf: tuple, map_size: tuple[int, int]) -> None:
    photo, outline, frame = leaf
    mask, maps = make_maps(photo, outline, frame, map_size, {"source": "auto", "water": "auto"})
    assert mask.shape == map_size[::-1] and mask.dtype == bool
    assert cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)[0] == 2
    for point in (outline.base, outline.tip):
        column, down = np.floor(frame.cells(point, map_size)).astype(int)
        assert mask[map_size[1] - 1 - down, column]
    assert maps["source"].sum() == pytest.approx(1.0) and (maps["source"][~mask] == 0.0).all()
    np.testing.assert_array_equal(maps["water"], mask)
    if min(map_size) >= 37:
        x, y = photo_points(frame, map_size)
        near = np.hypot(x - BASE[0], y - BASE[1]) < 0.05 * outline.length
        assert (maps["source"][~near] == 0.0).all()
        area = mask.mean() * frame.size[0] * frame.size[1]
        assert area == pytest.approx(cv2.contourArea(outline.points.astype(np.float32)), rel=0.02)


def test_pieces_are_joined_along_the_best_coverage() -> None:
    share = np.zeros((30, 30))
    share[5:, 2:27] = 1.0
    share[2:5, 14] = 0.3  # a petiole too thin for half a cell
    share[1, 14] = 0.6
    expected = share >= 0.3
    share[0, 0] = 0.9  # a crumb, less than a hundredth of the leaf
    np.testing.assert_array_equal(leaf_cells(share, base=(1, 14), tip=(29, 14)), expected)


def test_single_line_of_cells_is_bridged() -> None:
    share = np.array([[0.2, 0.0, 0.0, 0.9, 0.9, 0.1, 0.4]])
    np.testing.assert_array_equal(leaf_cells(share, (0, 0), (0, 6)), [[True] * 7])


@pytest.mark.parametrize("map_size", [(17, 23), (64, 48), (600, 700)])
@pytest.mark.parametrize("shrink", [1, 3])
def test_ramp_image_is_exact_at_cell_centres(
    leaf: tuple, tmp_path: Path, map_size: tuple[int, int], shrink: int
) -> None:
    photo, outline, frame = leaf
    width, height = WIDTH // shrink, HEIGHT // shrink
    x, y = (np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height
    ramp = np.rint(65535 * (0.2 + 0.3 * x[None] + 0.4 * y[:, None])).astype(np.uint16)
    path = write_image(tmp_path / "ramp.png", ramp)
    mask, maps = make_maps(photo, outline, frame, map_size, {"water": path})
    x, y = photo_points(frame, map_size)
    wanted = 0.2 + 0.3 * x / WIDTH + 0.4 * y / HEIGHT
    np.testing.assert_allclose(maps["water"][mask], wanted[mask], atol=1.1 / 65535)  # 16-bit rounding of the file


def test_interval_means() -> None:
    values = np.array([2.0, 4.0, 3.0])[:, None]
    means = interval_means(values, np.array([-1.0, 0.5, 1.5, 2.5, 4.0]))[:, 0]
    np.testing.assert_allclose(means, [2.0, 3.0, 3.5, 3.0])
    np.testing.assert_allclose(interval_means(values[:1], np.array([0.0, 0.3, 2.0]))[:, 0], [2.0, 2.0])


def test_dot_lands_at_its_place_in_maps(leaf: tuple, tmp_path: Path) -> None:
    photo, outline, frame = leaf
    dot = np.zeros((HEIGHT, WIDTH), np.uint8)
    dot[200:206, 150:156] = 255
    path = write_image(tmp_path / "dot.png", dot)
    map_size = (90, 120)
    _, maps = make_maps(photo, outline, frame, map_size, {"water": path, "source": path})
    rows, columns = np.mgrid[: map_size[1], : map_size[0]]
    for name in ("water", "source"):
        weights = maps[name] / maps[name].sum()
        u, v = ((columns + 0.5) * weights).sum() / map_size[0], ((rows + 0.5) * weights).sum() / map_size[1]
        assert u == pytest.approx((153.0 - frame.left) / frame.size[0], abs=0.02 / 90)  # a fiftieth of a cell
        assert v == pytest.approx((frame.bottom - 203.0) / frame.size[1], abs=0.02 / 120)


def test_black_source_is_refused(leaf: tuple, tmp_path: Path) -> None:
    path = write_image(tmp_path / "black.png", np.zeros((20, 20), np.uint8))
    with pytest.raises(InputError, match=r"black\.png: maps: source"):
        make_maps(*leaf, (32, 32), {"source": path})


@pytest.mark.parametrize("map_size", [(128, 128), (256, 256), (96, 256)])
def test_automatic_veins_are_the_drawn_ones(leaf: tuple, map_size: tuple[int, int]) -> None:
    photo, outline, frame = leaf
    mask, maps = make_maps(photo, outline, frame, map_size, {"venation": "auto", "stomata": "auto"})
    veins = maps["venation"]
    # On the coarsest map even petiole and midrib are narrower than two cells: drawn wider, and paler by as much.
    least, midrib_least = (0.7, 0.15) if map_size == (128, 128) else (0.95, 0.3)
    assert veins.min() == 0.0 and least < veins.max() <= 1.0 and (veins[~mask] == 0.0).all()
    np.testing.assert_allclose(maps["stomata"][mask], 1.0 - 0.8 * veins[mask])

    def at(points: np.ndarray) -> np.ndarray:
        column, down = frame.cells(points, map_size).T
        return veins[map_size[1] - 1 - down.astype(int), column.astype(int)]

    share = np.linspace(0.15, 0.75, 15)[:, None]
    lines = [start + share * (end - start) for start, end in vein_lines()]
    for number, line in enumerate(lines):
        assert (at(line) > (midrib_least if number == 0 else 0.02)).mean() >= 0.8, number
    midrib = at(lines[0])
    assert midrib[0] > midrib[-1]  # Murray: the flow gathers towards the base
    between = np.array([[210.0 + side * 60.0, height - 50.0] for side in (-1, 1) for height in (195, 250, 305, 360)])
    assert (at(between) < 0.1).mean() >= 0.7
    assert 0.02 < (veins > 0.05).sum() / mask.sum() < 0.35


def test_what_veins_carry_does_not_depend_on_the_map(leaf: tuple) -> None:
    """The capacity of all veins together, an area, from maps on which most are narrower than two cells to fine ones."""
    photo, outline, frame = leaf
    totals = []
    for cells in (128, 256, 512, 1024):
        _, maps = make_maps(photo, outline, frame, (cells, cells), {"venation": "auto"})
        totals.append(maps["venation"].mean())
    # Lines are whole pixels wide and have 8-bit values: a tenth either way. Undiluted, the ratio is above 4.
    assert max(totals) / min(totals) < 1.25


def test_venation_is_one_tree_two_cells_wide(leaf: tuple) -> None:
    photo, outline, frame = leaf
    _, maps = make_maps(photo, outline, frame, (256, 256), {"venation": "auto"})
    drawn = (maps["venation"] > 0.0).astype(np.uint8)
    count, _, stats, _ = cv2.connectedComponentsWithStats(drawn, connectivity=4)
    assert stats[1:, cv2.CC_STAT_AREA].max() > 0.97 * drawn.sum(), count
    square = drawn[:-1, :-1] & drawn[1:, :-1] & drawn[:-1, 1:] & drawn[1:, 1:]  # two by two cells, all vein
    wide = np.zeros_like(drawn)
    for rows in (slice(None, -1), slice(1, None)):
        for columns in (slice(None, -1), slice(1, None)):
            wide[rows, columns] |= square
    assert wide.sum() > 0.95 * drawn.sum()


def test_petiole_coverage_reference() -> None:
    """The drawn test leaf is what the other tests take it for."""
    assert coverage(np.array([[10.0, 10.0], [20.0, 10.0], [20.0, 30.0], [10.0, 30.0]])).sum() == pytest.approx(
        200.0, rel=0.03
    )
    assert TIP[1] < BASE[1]
