"""Maps: alignment, connectivity at every size, the source's sum, and veins where the picture shows them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from leaf_pictures import BASE, HEIGHT, TIP, WIDTH, coverage, draw_leaf, vein_lines, write_image
from leafwarp.errors import InputError, OutputError
from leafwarp.leaf.image.photo import Photo, read_photo
from leafwarp.leaf.leaf import Findings, Leaf, MapFrame
from leafwarp.leaf.maps import files as map_files
from leafwarp.leaf.maps.cells import block_means, is_finer, leaf_cells
from leafwarp.leaf.maps.files import LARGEST_SIDE, interval_means, read_map, write_maps
from leafwarp.leaf.maps.make import PixelFrame, fine_venation, make_maps
from leafwarp.leaf.segment.silhouette import silhouette
from leafwarp.leaf.shape.outline import Outline, find_outline
from leafwarp.leaf.venation.veins import Branch, find_veins
from leafwarp.prepare import prepare_scene_leaf
from leafwarp.run import save_maps
from leafwarp.scene.file import load_scene

QUANTUM = 0.5 / 65535.0  # by which a 16-bit picture rounds
ROUNDING = 1e-6  # of float64 sums over some thousand pixels, as a share of that

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


@pytest.fixture(scope="module")
def branches(leaf: tuple) -> list[Branch]:
    """The veins of that leaf, which know nothing of maps."""
    photo, outline, _ = leaf
    return find_veins(photo, outline)


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


def test_interval_means_finer_than_samples_join_them_by_lines() -> None:
    values = np.array([2.0, 4.0, 3.0])[:, None]
    means = interval_means(values, np.array([-0.4, 0.5, 0.7, 1.3, 1.5, 1.6]))[:, 0]
    # From 2 at 0.5 by a straight line to 4 at 1.5, and on towards 3 at 2.5: each mean is the value at the middle.
    np.testing.assert_allclose(means, [2.0, 2.2, 3.0, 3.8, 3.95])
    np.testing.assert_allclose(interval_means(values[:1], np.array([0.0, 0.3, 0.9]))[:, 0], [2.0, 2.0])


def test_interval_means_of_whole_samples_are_the_samples() -> None:
    values = np.array([0.0, 1.0, 1.0, 0.2, 0.6, 0.9])[:, None]
    means = interval_means(values, np.array([-2.0, 0.0, 1.0, 2.0, 4.0, 5.0, 6.0, 9.0]))[:, 0]
    np.testing.assert_allclose(means, [0.0, 0.0, 1.0, 0.6, 0.6, 0.9, 0.9])
    # A part of a sample on a slope takes its share of the slope, at an extreme it does not.
    halves = interval_means(values, np.array([0.0, 1.0, 2.0, 4.0, 4.5, 6.0]))[:, 0]
    assert halves[3] == pytest.approx(0.6 - 0.25 * 0.3)
    np.testing.assert_allclose(interval_means(values[:1], np.array([0.0, 0.3, 4.0]))[:, 0], [0.0, 0.0])


def test_interval_means_find_a_step_within_a_sample() -> None:
    """Between flat grounds a sample is a step, at the place that its mean says."""
    values = np.array([0.0, 0.0, 0.25, 1.0, 1.0, 1.0])[:, None]  # a step up at 2.75
    means = interval_means(values, np.array([0.0, 2.5, 2.75, 4.0, 6.0]))[:, 0]
    np.testing.assert_allclose(means, [0.0, 0.0, 1.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(interval_means(values, np.array([0.0, 2.875, 6.0]))[0, 0], 0.125 / 2.875)


def test_dot_lands_at_its_place_in_maps(leaf: tuple, tmp_path: Path) -> None:
    photo, outline, frame = leaf
    dot = np.zeros((HEIGHT, WIDTH), np.uint8)
    dot[200:206, 150:156] = 255
    path = write_image(tmp_path / "dot.png", dot)
    map_size = (90, 120)
    _, maps = make_maps(photo, outline, frame, map_size, {"water": path, "source": path})
    # Each cell holds the share of it that the dot covers.
    covered = []
    for low, high, first, last, count in (
        (150, 156, frame.left, frame.right, 90),
        (200, 206, frame.top, frame.bottom, 120),
    ):
        bounds = np.linspace(first, last, count + 1)
        covered.append(np.diff(np.clip(bounds, low, high)) / np.diff(bounds))
    expected = np.outer(covered[1][::-1], covered[0])
    assert 0.0 < expected.max() <= 1.0
    np.testing.assert_allclose(maps["water"], expected, atol=1e-12)
    np.testing.assert_allclose(maps["source"], expected / expected.sum(), atol=1e-12)


def test_black_source_is_refused(leaf: tuple, tmp_path: Path) -> None:
    path = write_image(tmp_path / "black.png", np.zeros((28, 21), np.uint8))
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
    assert (maps["stomata"][mask] > 0.0).all() and maps["stomata"].max() <= 1.0

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


def test_what_veins_carry_does_not_depend_on_the_map(leaf: tuple, branches: list[Branch]) -> None:
    """The capacity of all veins together, an area, from maps on which most are narrower than two cells to fine ones."""
    photo, outline, frame = leaf
    totals = []
    for cells in (128, 256, 512, 1024):
        _, maps = make_maps(photo, outline, frame, (cells, cells), {"venation": "auto"}, branches)
        totals.append(maps["venation"].mean())
    # Lines are whole pixels wide and have 8-bit values: a tenth either way. Undiluted, the ratio is above 4.
    assert max(totals) / min(totals) < 1.25


def test_venation_is_one_tree_two_cells_wide(leaf: tuple, branches: list[Branch]) -> None:
    photo, outline, frame = leaf
    _, maps = make_maps(photo, outline, frame, (256, 256), {"venation": "auto"}, branches)
    drawn = (maps["venation"] > 0.0).astype(np.uint8)
    count, _, stats, _ = cv2.connectedComponentsWithStats(drawn, connectivity=4)
    assert stats[1:, cv2.CC_STAT_AREA].max() > 0.97 * drawn.sum(), count
    square = drawn[:-1, :-1] & drawn[1:, :-1] & drawn[:-1, 1:] & drawn[1:, 1:]  # two by two cells, all vein
    wide = np.zeros_like(drawn)
    for rows in (slice(None, -1), slice(1, None)):
        for columns in (slice(None, -1), slice(1, None)):
            wide[rows, columns] |= square
    assert wide.sum() > 0.95 * drawn.sum()


def stomata_of(leaf: tuple, branches: list[Branch], size: tuple[int, int] = (256, 256), seed: int = 0) -> np.ndarray:
    photo, outline, frame = leaf
    return make_maps(photo, outline, frame, size, {"stomata": "auto"}, branches, seed)[1]["stomata"]


def test_stomata_are_fewer_on_and_near_veins_and_even_elsewhere(leaf: tuple, branches: list[Branch]) -> None:
    photo, outline, frame = leaf
    mask, maps = make_maps(photo, outline, frame, (256, 256), {"venation": "auto", "stomata": "auto"}, branches)
    veins, stomata = maps["venation"], maps["stomata"]
    away = cv2.distanceTransform((veins < 0.02).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    on, beside, far = mask & (veins > 0.4), mask & (away > 0.0) & (away < 2.0), mask & (away > 8.0)
    assert stomata[on].mean() < 0.75 * stomata[beside].mean() < 0.75 * 0.95 * stomata[far].mean()
    spread = stomata[far].std() / stomata[far].mean()
    assert 0.03 < spread < 0.1
    # The map's halves have the same density: nothing but the veins makes a trend.
    middle = mask.shape[1] // 2
    assert stomata[:, :middle][far[:, :middle]].mean() == pytest.approx(
        stomata[:, middle:][far[:, middle:]].mean(), rel=0.03
    )


def test_stomata_follow_the_seed_and_the_place_not_the_map(leaf: tuple, branches: list[Branch]) -> None:
    first, again, other = (stomata_of(leaf, branches, seed=seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    inside = (first > 0.0) & (other > 0.0)
    assert np.abs(first - other)[inside].max() > 0.05
    fine = stomata_of(leaf, branches, (512, 512))
    averaged = fine.reshape(256, 2, 256, 2).mean(axis=(1, 3))
    off_margin = cv2.erode((first > 0.0).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert np.abs(averaged - first)[off_margin].mean() < 0.02  # of about 0.75; veins are sharper on the finer map


def test_given_venation_rules_the_stomata(leaf: tuple, tmp_path: Path) -> None:
    picture = np.zeros((HEIGHT, WIDTH), np.uint8)
    picture[:, 120:130] = 255
    path = write_image(tmp_path / "stripe.png", picture)
    photo, outline, frame = leaf
    mask, maps = make_maps(photo, outline, frame, (200, 300), {"venation": path, "stomata": "auto"})
    x, _ = photo_points(frame, (200, 300))
    on, off = mask & (np.abs(x - 125.0) < 3.0), mask & (np.abs(x - 125.0) > 30.0)
    assert maps["stomata"][on].max() < 0.3 and maps["stomata"][off].min() > 0.5


def test_veins_found_before_are_used(leaf: tuple) -> None:
    photo, outline, frame = leaf
    line = np.column_stack([np.linspace(130.0, 290.0, 200), np.full(200, 230.0)])
    _, maps = make_maps(photo, outline, frame, (128, 128), {"venation": "auto"}, [Branch(line, np.full(200, 0.5))])
    rows = np.nonzero(maps["venation"].any(axis=1))[0]
    down = np.floor(frame.cells(np.array([200.0, 230.0]), (128, 128))[1])
    assert set(rows.tolist()) <= {127 - int(down) + shift for shift in (-2, -1, 0, 1, 2)}


def test_true_holes_are_no_leaf(leaf: tuple) -> None:
    photo, outline, frame = leaf
    angle = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    hole = np.column_stack([240.0 + 30.0 * np.cos(angle), 250.0 + 40.0 * np.sin(angle)])
    whole = make_maps(photo, outline, frame, (200, 300), {"water": "auto"})[0]
    holed = make_maps(photo, dataclasses.replace(outline, holes=(hole,)), frame, (200, 300), {"water": "auto"})[0]
    cell = frame.size[0] * frame.size[1] / (200 * 300)
    assert (whole.sum() - holed.sum()) * cell == pytest.approx(np.pi * 30.0 * 40.0, rel=0.05)
    x, y = photo_points(frame, (200, 300))
    assert not holed[((x - 240.0) / 28.0) ** 2 + ((y - 250.0) / 38.0) ** 2 < 1.0].any()


@pytest.mark.parametrize("size", [(WIDTH, HEIGHT - 30), (HEIGHT, WIDTH), (100, 140)])
def test_picture_out_of_proportion_is_refused(leaf: tuple, tmp_path: Path, size: tuple[int, int]) -> None:
    path = write_image(tmp_path / "map.png", np.full(size[::-1], 200, np.uint8))
    with pytest.raises(InputError, match=rf"map\.png: maps: water: is {size[0]} x {size[1]} pixels, .* 420 x 560"):
        make_maps(*leaf, (32, 32), {"water": path})


@pytest.mark.parametrize("size", [(WIDTH, HEIGHT), (WIDTH // 2, HEIGHT // 2), (3, 4), (425, 560), (1260, 1681)])
def test_picture_in_proportion_is_accepted_at_any_size(leaf: tuple, tmp_path: Path, size: tuple[int, int]) -> None:
    path = write_image(tmp_path / "map.png", np.full(size[::-1], 51, np.uint8))
    mask, maps = make_maps(*leaf, (32, 32), {"water": path})
    np.testing.assert_allclose(maps["water"][mask], 0.2)


def check_read_back(read: dict[str, np.ndarray], maps: dict[str, np.ndarray], mask: np.ndarray) -> None:
    """Maps are what was written, to its 16 bits. The source is written with 1 as its largest."""
    assert list(read) == list(maps)
    for name in maps:
        scale = [1.0 / values.max() if name == "source" else 1.0 for values in (read[name], maps[name])]
        difference = np.abs(scale[0] * read[name][mask] - scale[1] * maps[name][mask])
        assert difference.max() <= QUANTUM * (1.0 + ROUNDING), name


@pytest.mark.parametrize("map_size", [(256, 256), (48, 96), (37, 91), (16, 20), (8, 200), (1, 64)])
def test_written_maps_read_back_the_same(
    leaf: tuple, branches: list[Branch], tmp_path: Path, map_size: tuple[int, int]
) -> None:
    photo, outline, frame = leaf
    wanted = dict.fromkeys(("venation", "stomata", "water", "source"), "auto")
    mask, maps = make_maps(photo, outline, frame, map_size, wanted, branches)
    files = write_maps(maps, mask, tmp_path, "leaf", frame=frame, photo_size=photo.size)
    assert [file.name for file in files] == [f"leaf.{name}.png" for name in wanted]
    again, read = make_maps(photo, outline, frame, map_size, dict(zip(wanted, files, strict=True)))
    np.testing.assert_array_equal(again, mask)
    check_read_back(read, maps, mask)
    picture = cv2.imread(str(files[0]), cv2.IMREAD_UNCHANGED)
    assert picture.dtype == np.uint16 and picture.ndim == 2
    across = picture.shape[1] / photo.size[0]
    # Upright and not mirrored: the petiole's vein is where the petiole is in the photo.
    assert picture[int(500.0 * picture.shape[0] / HEIGHT), int(BASE[0] * across)] > 0.5 * picture.max()


@pytest.mark.parametrize("largest", [LARGEST_SIDE, 500])
@pytest.mark.parametrize("map_size", [(96, 96), (70, 150)])
def test_any_written_map_reads_back(
    leaf: tuple, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, map_size: tuple[int, int], largest: int
) -> None:
    """Cells of any value beside one another, in pictures of many pixels a cell and of the fewest."""
    photo, outline, frame = leaf
    monkeypatch.setattr(map_files, "LARGEST_SIDE", largest)
    mask, _ = make_maps(photo, outline, frame, map_size, {"water": "auto"})
    random = np.random.default_rng(0)
    maps = {
        "venation": random.random(mask.shape),
        "stomata": np.rint(random.random(mask.shape)),
        "water": 0.5 + np.rint(3.0 * random.random(mask.shape)) / 65535.0,  # steps as small as the rounding
    }
    maps = {name: np.where(mask, values, 0.0) for name, values in maps.items()}
    files = write_maps(maps, mask, tmp_path, "leaf", frame=frame, photo_size=photo.size)
    check_read_back(make_maps(photo, outline, frame, map_size, dict(zip(maps, files, strict=True)))[1], maps, mask)


@pytest.mark.parametrize("map_size", [(32, 32), (24, 40)])
def test_maps_of_a_run_given_back_prepare_the_same_leaf(
    small_scene: Path, tmp_path: Path, map_size: tuple[int, int]
) -> None:
    size = f"maps.size={list(map_size)}"
    first = prepare_scene_leaf(load_scene(small_scene, [size]), None)
    files = save_maps(first, tmp_path, "leaf")
    names = [file.suffixes[-2][1:] for file in files]
    given = [f"maps.{name}='{file}'" for name, file in zip(names, files, strict=True)]
    second = prepare_scene_leaf(load_scene(small_scene, [size, *given]), None)
    assert set(names) == set(first.maps) == {"venation", "stomata", "water", "source"}
    np.testing.assert_array_equal(second.mask, first.mask)
    check_read_back(second.maps, first.maps, first.mask)
    assert all((values[~second.mask] == 0.0).all() for values in second.maps.values())
    # What faces between the cells conduct is told by finer veins, which are written in the map's stead.
    inside = np.kron(first.mask, np.ones((4, 4), bool))
    np.testing.assert_array_equal(
        block_means(first.fine_venation, first.mask.shape)[first.mask] > 0.0, first.maps["venation"][first.mask] > 0.0
    )
    check_read_back({"venation": second.fine_venation}, {"venation": first.fine_venation}, inside)


@pytest.mark.parametrize("share, parts", [(0.9, 4), (0.25, 2), (0.12, 1)])
def test_a_written_venation_is_as_fine_as_its_picture_has_pixels_for(
    leaf: tuple, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, share: float, parts: int
) -> None:
    """A leaf that fills a part of a large photo: its cells come back right, however small it is."""
    photo = leaf[0]
    frame = PixelFrame(10, 20, 10 + round(share * 400), 20 + round(share * 400))
    monkeypatch.setattr("leafwarp.leaf.maps.files.LARGEST_SIDE", 1000)
    monkeypatch.setattr("leafwarp.leaf.maps.files.LARGEST_SIDE_OF_ALL", 1000)
    mask = np.ones((25, 25), bool)
    fine = np.random.default_rng(3).uniform(0.0, 1.0, (100, 100))
    cells = block_means(fine, mask.shape)
    (path,) = write_maps(
        {"venation": cells}, mask, tmp_path, "leaf", frame=frame, photo_size=photo.size, fine_venation=fine
    )
    read = read_map(path, "venation", photo, frame, (25 * parts, 25 * parts))
    np.testing.assert_allclose(read, block_means(fine, read.shape), atol=2 * QUANTUM)
    again = read_map(path, "venation", photo, frame, (25, 25))
    np.testing.assert_allclose(again, cells, atol=2 * QUANTUM)
    assert is_finer(read, mask.shape) == (parts > 1)


def test_a_coarse_picture_is_read_no_finer_than_its_pixels(leaf: tuple, tmp_path: Path) -> None:
    photo, outline, frame = leaf
    map_size = tuple(int(side) // 8 for side in frame.size)
    for shrink, parts in ((1, 4), (4, 2), (8, 1)):
        picture = np.zeros((HEIGHT // shrink, WIDTH // shrink), np.uint8)
        path = write_image(tmp_path / f"veins{shrink}.png", picture)
        fine = fine_venation(photo, outline, frame, map_size, path)
        assert fine.shape == (map_size[1] * parts, map_size[0] * parts), shrink


def test_maps_without_a_photo_cover_their_own_rectangle(tmp_path: Path) -> None:
    values = np.linspace(0.0, 1.0, 12).reshape(4, 3)
    (file,) = write_maps({"water": values}, np.ones((4, 3), bool), tmp_path, "leaf")
    picture = cv2.imread(str(file), cv2.IMREAD_UNCHANGED) / 65535.0
    assert picture.shape[0] * 3 == picture.shape[1] * 4
    assert picture[0, -1] == picture.max() == 1.0 and picture[-1, 0] == 0.0  # the top row first


def test_folder_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"leaf\.water\.png: cannot be written"):
        write_maps({"water": np.ones((4, 4))}, np.ones((4, 4), bool), tmp_path / "missing", "leaf")


def test_frame_of_a_prepared_leaf_is_the_one_it_was_made_with(leaf: tuple) -> None:
    photo, outline, frame = leaf
    pixel = 1.234e-4
    origin = ((frame.left - outline.base[0]) * pixel, (outline.base[1] - frame.bottom) * pixel)
    made = Leaf(
        mesh=None,
        frame=MapFrame(origin, (frame.size[0] * pixel, frame.size[1] * pixel)),
        length=outline.length * pixel,
        texture=photo.colour,
        findings=Findings(outline.points, tuple(outline.base), pixel=pixel),
    )
    assert PixelFrame.of(made) == frame


def test_petiole_coverage_reference() -> None:
    """The drawn test leaf is what the other tests take it for."""
    assert coverage(np.array([[10.0, 10.0], [20.0, 10.0], [20.0, 30.0], [10.0, 30.0]])).sum() == pytest.approx(
        200.0, rel=0.03
    )
    assert TIP[1] < BASE[1]
