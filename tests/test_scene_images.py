"""The scenes' drawn leaves: reproducible, sound as photos to segment, and the drawing's geometry."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

SCENES = Path(__file__).parent.parent / "scenes"
NAMES = ("bramble", "blade", "cut", "still")
MAX_FILE_BYTES = 2_500_000
# Another OpenCV or processor rounds blurs and resizes differently in the last bit of a float32: one 8-bit
# level, and more only where that bit moves a pixel across a threshold.
LEVEL_TOLERANCE = 1
SHARE_ACROSS_THRESHOLD = 1e-4
# Eight sub-scanlines a pixel: an edge's end is off by at most a sixteenth of a pixel, mostly cancelling.
AREA_TOLERANCE = 0.25


def draw(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs the drawing script as a user would."""
    command = [sys.executable, str(SCENES / "draw_leaves.py"), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


def read(path: Path) -> np.ndarray:
    """An image as it is stored, colour in RGB order."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, f"{path} cannot be read"
    return image[..., ::-1] if image.ndim == 3 else image


def leaf_mask(image: np.ndarray) -> np.ndarray:
    """The leaf, by saturation of colour against the pale or grey background, and its brown petiole."""
    lab = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2LAB).astype(np.float32)
    border = np.concatenate([lab[:8].reshape(-1, 3), lab[-8:].reshape(-1, 3)])
    return (np.linalg.norm(lab[..., 1:] - np.median(border, axis=0)[1:], axis=2) > 14).astype(np.uint8)


@pytest.fixture
def drawing(monkeypatch: pytest.MonkeyPatch):
    """Imports modules of the drawing package, which lies beside the script."""
    monkeypatch.syspath_prepend(str(SCENES))

    def load(name: str) -> ModuleType:
        return importlib.import_module(f"drawing.{name}")

    return load


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `still`, drawn afresh with its vein mask."""
    folder = tmp_path_factory.mktemp("drawn")
    result = draw("still", "--output", str(folder), "--veins")
    assert result.returncode == 0, result.stderr
    assert result.stdout == ""
    return folder


def test_committed_picture_is_what_the_script_draws(drawn: Path) -> None:
    committed, fresh = read(SCENES / "still.png"), read(drawn / "still.png")
    assert committed.shape == fresh.shape
    difference = np.abs(committed.astype(int) - fresh.astype(int))
    assert np.mean(difference > LEVEL_TOLERANCE) <= SHARE_ACROSS_THRESHOLD


def test_two_runs_write_the_same_bytes(drawn: Path, tmp_path: Path) -> None:
    assert draw("still", "--output", str(tmp_path), "--veins").returncode == 0
    for name in ("still.png", "still_veins.png"):
        assert (tmp_path / name).read_bytes() == (drawn / name).read_bytes()


def test_only_what_is_asked_for_is_written(drawn: Path) -> None:
    assert sorted(path.name for path in drawn.iterdir()) == ["still.png", "still_veins.png"]


def test_unknown_picture_is_refused(tmp_path: Path) -> None:
    result = draw("brambel", "--output", str(tmp_path / "none"))
    assert result.returncode == 2
    assert "'brambel'" in result.stderr and "bramble" in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("name", NAMES)
def test_committed_picture_is_a_photo_with_one_whole_leaf(name: str) -> None:
    path = SCENES / f"{name}.png"
    image = read(path)
    assert path.stat().st_size < MAX_FILE_BYTES
    assert image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3
    mask = cv2.morphologyEx(leaf_mask(image), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask)
    areas = np.sort(stats[1:, cv2.CC_STAT_AREA])[::-1]
    assert areas[0] > 0.04 * mask.size
    assert areas[1:].sum() < 0.002 * areas[0], "the leaf falls apart"
    border = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
    assert not border.any(), "the leaf touches the picture's border"


@pytest.mark.parametrize("name", NAMES)
def test_committed_picture_shows_the_leaf_that_is_drawn(name: str, drawing) -> None:
    picture = drawing("catalogue").PICTURES[name]
    fields = drawing("leaves").LeafFields(picture.shape)
    truth = np.maximum(fields.lamina, fields.petiole) > 0.5
    seen = leaf_mask(read(SCENES / f"{name}.png")) > 0
    assert np.count_nonzero(truth & seen) / np.count_nonzero(truth | seen) > 0.95


def test_bramble_petiole_is_wide_and_long_enough_to_mesh(drawing) -> None:
    shape = drawing("catalogue").PICTURES["bramble"].shape
    stalk = drawing("curves").arc_length(shape.petiole.curve())[-1]
    lowest = min(y for run in shape.half_outline for _, y in run)
    whole = 1.0 + stalk
    assert shape.petiole.widths().min() >= 0.02 * whole
    assert 0.08 * whole < stalk + lowest < 0.16 * whole


@pytest.mark.parametrize("name", NAMES)
def test_main_veins_are_paler_than_the_lamina_beside_them(name: str, drawing) -> None:
    fields = drawing("leaves").LeafFields(drawing("catalogue").PICTURES[name].shape)
    lightness = cv2.cvtColor(np.ascontiguousarray(read(SCENES / f"{name}.png")), cv2.COLOR_RGB2LAB)[..., 0]
    all_veins = np.max([fields.veins(order) for order in range(3)], axis=0)
    for order, least in ((0, 20.0), (1, 8.0)):
        vein = fields.veins(order)
        near = cv2.dilate(vein, np.ones((13, 13), np.uint8)) > 0
        beside = near & (all_veins == 0.0) & (fields.lamina == 1.0)
        assert lightness[vein > 0.9].mean() - lightness[beside].mean() > least


def test_vein_mask_is_a_tree_inside_the_lamina(drawn: Path, drawing) -> None:
    veins = read(drawn / "still_veins.png")
    fields = drawing("leaves").LeafFields(drawing("catalogue").PICTURES["still"].shape)
    assert veins.ndim == 2 and veins.shape == fields.lamina.shape
    leaf = np.maximum(fields.lamina, fields.petiole)
    assert np.all(leaf[veins > 127] > 0.5)
    assert cv2.connectedComponents((veins > 0).astype(np.uint8))[0] == 2  # background and one tree


def test_teeth_end_at_the_secondaries(drawing) -> None:
    fields = drawing("leaves").LeafFields(drawing("catalogue").PICTURES["bramble"].shape)
    secondaries = [vein for vein in fields.venation.veins if vein.order == 1]
    assert len(secondaries) == 18
    outlines = np.concatenate([margin.toothed for margin in fields.margins.values()])
    bases = np.concatenate([margin.smooth for margin in fields.margins.values()])
    for vein in secondaries:
        tip = vein.points[-1]
        assert np.linalg.norm(outlines - tip, axis=1).min() < 0.004
        assert np.linalg.norm(tip) > np.linalg.norm(bases[np.argmin(np.linalg.norm(bases - tip, axis=1))])


def test_coverage_has_the_polygon_s_area_either_way_round(drawing) -> None:
    raster = drawing("raster")
    rng = np.random.default_rng(3)
    for _ in range(10):
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 9))
        polygon = 50.0 + rng.uniform(15.0, 45.0, (9, 1)) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        x, y = polygon.T
        area = 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
        filled = raster.coverage([polygon], (100, 100))
        assert filled.sum() == pytest.approx(area, abs=AREA_TOLERANCE)
        np.testing.assert_allclose(raster.coverage([polygon[::-1]], (100, 100)), filled, atol=1e-6)


def test_coverage_of_pixel_aligned_boxes_is_exact_and_overlaps_do_not_add(drawing) -> None:
    box = np.array([[2.0, 3.0], [6.5, 3.0], [6.5, 8.0], [2.0, 8.0]])
    filled = drawing("raster").coverage([box, box[::-1]], (10, 10))
    expected = np.zeros((10, 10), np.float32)
    expected[3:8, 2:6] = 1.0
    expected[3:8, 6] = 1.0  # half covered by each of two boxes: their areas add up within one pixel
    np.testing.assert_allclose(filled, expected, atol=1e-6)


def test_coverage_is_clipped_to_the_picture(drawing) -> None:
    box = np.array([[-20.0, -20.0], [5.0, -20.0], [5.0, 40.0], [-20.0, 40.0]])
    filled = drawing("raster").coverage([box], (8, 8))
    assert np.all(filled[:, :5] == 1.0) and np.all(filled[:, 5:] == 0.0)
    assert not drawing("raster").coverage([], (4, 6)).any()


def test_placement_goes_there_and_back(drawing) -> None:
    placement = drawing("catalogue").PICTURES["blade"].shape.placement
    x, y = placement.leaf_coordinates()
    rows, columns = np.array([10, 900, 1750]), np.array([400, 250, 20])
    there = placement.to_picture(np.stack([x[rows, columns], y[rows, columns]], axis=1))
    np.testing.assert_allclose(there, np.stack([columns, rows], axis=1) + 0.5, atol=1e-9)


def test_smooth_curve_meets_its_points(drawing) -> None:
    points = [(0.0, 0.0), (0.3, 0.1), (0.35, 0.5), (0.1, 0.9)]
    curve = drawing("curves").smooth_curve(points, 0.001)
    for point in points:
        assert np.linalg.norm(curve - point, axis=1).min() < 0.001
    assert np.linalg.norm(np.diff(curve, axis=0), axis=1).max() < 0.002


def test_network_distance_falls_to_nought_on_borders_and_is_at_most_a_cell(drawing) -> None:
    u, v = np.meshgrid(np.arange(0.0, 12.0, 0.02), np.arange(0.0, 6.0, 0.02))
    rng = np.random.default_rng(8)
    distance = drawing("raster").cell_network(u.ravel(), v.ravel(), 2.0, 1.0, rng).reshape(u.shape)
    assert distance.min() >= 0.0 and distance.min() < 0.02
    assert distance.max() < 2.0
    # A distance's slope is 1 along its steepest direction, but at kinks (borders and ridges).
    slope = np.hypot(*np.gradient(distance, 0.02))
    assert np.median(slope) == pytest.approx(1.0, abs=0.02)
