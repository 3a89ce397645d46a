"""prepare_leaf as a whole: scale, frame, texture, arguments, cache."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from leaf_pictures import (
    BASE,
    HEIGHT,
    LAMINA,
    WIDTH,
    blade_outline,
    coverage,
    draw_leaf,
    true_length,
    write_image,
)
from leafwarp.errors import InputError
from leafwarp.leaf import Leaf, LeafRequest, prepare_leaf
from leafwarp.leaf.cache import load_leaf
from leafwarp.leaf.mesh.topology import check_topology

LENGTH = 0.08  # [m]
PIXELS = true_length(teeth=40, depth=0.06)
AUTO = {"venation": "auto", "stomata": "auto", "water": "auto", "source": "auto"}
DOT, DOT_COLOUR = (160, 210), (220, 40, 160)


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    picture = draw_leaf(teeth=40, depth=0.06)
    picture[DOT[1] - 4 : DOT[1] + 4, DOT[0] - 4 : DOT[0] + 4] = DOT_COLOUR
    return write_image(tmp_path_factory.mktemp("prepare") / "leaf.png", picture)


@pytest.fixture(scope="module")
def leaf(image: Path) -> Leaf:
    return prepared(image, length=LENGTH, vertices=600, map_size=(80, 120), maps=AUTO)


def prepared(image: Path, cache: Path | None = None, **asked) -> Leaf:
    return prepare_leaf(LeafRequest(image, **asked), cache)


def position(point: tuple[float, float], base: tuple[float, float] = BASE) -> np.ndarray:
    """Place [m] of a photo point."""
    return np.array([[point[0] - base[0], base[1] - point[1]]]) * (LENGTH / PIXELS)


def assert_same(one: Leaf, two: Leaf) -> None:
    for attribute in fields(one.mesh):
        np.testing.assert_array_equal(getattr(one.mesh, attribute.name), getattr(two.mesh, attribute.name))
    assert (one.frame, one.length) == (two.frame, two.length)
    np.testing.assert_array_equal(one.texture, two.texture)
    assert (one.mask is None) == (two.mask is None) and one.maps.keys() == two.maps.keys()
    if one.mask is not None:
        np.testing.assert_array_equal(one.mask, two.mask)
    assert (one.fine_venation is None) == (two.fine_venation is None)
    if one.fine_venation is not None:
        np.testing.assert_array_equal(one.fine_venation, two.fine_venation)
    for name, values in one.maps.items():
        np.testing.assert_array_equal(values, two.maps[name])
    for attribute in fields(one.findings):
        mine, its = (getattr(leaf.findings, attribute.name) for leaf in (one, two))
        if attribute.name == "veins":
            assert len(mine) == len(its)
            for line, its_line in zip(mine, its, strict=True):
                np.testing.assert_array_equal(np.column_stack(line), np.column_stack(its_line))
        elif attribute.name != "seconds":
            np.testing.assert_array_equal(mine, its)


def test_leaf_is_complete(leaf: Leaf) -> None:
    check_topology(leaf.mesh)
    assert leaf.length == LENGTH
    assert leaf.mask.shape == (120, 80) and set(leaf.maps) == set(AUTO)
    for name, values in leaf.maps.items():
        assert values.dtype == np.float64 and values.shape == leaf.mask.shape, name
        assert 0.0 <= values.min() and values.max() <= 1.0 and (values[~leaf.mask] == 0.0).all(), name
    uv = leaf.uv
    assert uv.min() > 0.0 and uv.max() < 1.0
    assert np.hypot(*leaf.mesh.positions.T).max() == pytest.approx(LENGTH, rel=0.02)
    assert leaf.texture.dtype == np.uint8


def test_frame_is_the_bounding_box_and_three_percent(leaf: Leaf) -> None:
    low, high = leaf.mesh.positions.min(axis=0), leaf.mesh.positions.max(axis=0)
    margin = 0.03 * (high - low).max()
    pixel = LENGTH / PIXELS
    origin, size = np.array(leaf.frame.origin), np.array(leaf.frame.size)
    np.testing.assert_allclose(low - origin, margin, atol=3.0 * pixel)  # whole pixels, and the mesh cuts corners
    np.testing.assert_allclose(origin + size - high, margin, atol=3.0 * pixel)


def test_dot_is_at_its_uv_in_the_texture(leaf: Leaf) -> None:
    height, width = leaf.texture.shape[:2]
    reddish = (leaf.texture[..., 0] > 150) & (leaf.texture[..., 1] < 90)
    rows, columns = np.nonzero(reddish)
    found = np.array([(columns.mean() + 0.5) / width, 1.0 - (rows.mean() + 0.5) / height])
    wanted = leaf.frame.uv(position(DOT))[0]
    np.testing.assert_allclose(found, wanted, atol=3.0 / height)  # the base is found to a few pixels
    assert 40 <= len(rows) <= 80


def test_texture_is_bled_past_the_outline(leaf: Leaf) -> None:
    """No background shines through: every texel is as far from the paper's colour as the leaf is."""
    greenest = leaf.texture[..., 1].astype(int) - leaf.texture[..., 2]
    dot = (leaf.texture[..., 0] > 150) & (leaf.texture[..., 1] < 90)
    assert greenest[~dot].min() > 0.35 * (LAMINA[1] - LAMINA[2])
    assert (leaf.texture.min(axis=2) < 190).all()


def test_scale_by_pixels_per_metre(image: Path, leaf: Leaf) -> None:
    other = prepared(image, length=None, pixels_per_metre=PIXELS / LENGTH, vertices=600, map_size=None)
    assert other.length == pytest.approx(LENGTH, rel=0.02)
    assert other.mask is None and other.maps == {}


def test_mask_image_replaces_the_search(image: Path, tmp_path: Path) -> None:
    mask = write_image(tmp_path / "mask.png", np.rint(255 * coverage(blade_outline())).astype(np.uint8))
    leaf = prepared(image, length=LENGTH, mask=mask, base=(210.0, 420.0), vertices=200, map_size=None)
    size = np.ptp(leaf.mesh.positions, axis=0)
    assert size[1] / size[0] == pytest.approx(190.0 / 120.0, rel=0.03)  # the ellipse alone, no petiole
    black = write_image(tmp_path / "black.png", np.zeros((50, 50), np.uint8))
    with pytest.raises(InputError, match=r"black\.png: mask: no leaf"):
        prepared(image, length=LENGTH, mask=black, map_size=None)


def test_leaf_cut_by_the_picture_border(tmp_path: Path) -> None:
    path = write_image(tmp_path / "cut.png", draw_leaf()[:, 150:])
    leaf = prepared(path, length=LENGTH, vertices=300, map_size=(32, 32), maps={"water": 0.5})
    check_topology(leaf.mesh)
    assert set(np.unique(leaf.maps["water"])) == {0.0, 0.5}
    assert leaf.uv.min() > 0.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"length": None}, "length: missing"),
        ({"length": -1.0}, "length: value -1.0"),
        ({"length": float("nan")}, "length: value nan"),
        ({"length": None, "pixels_per_metre": 0.0}, "pixels_per_metre: value 0.0"),
        ({"vertices": 2}, "vertices: value 2"),
        ({"map_size": (0, 10)}, "map_size: value"),
        ({"maps": {"colour": "auto"}}, "maps: 'colour' is not accepted; accepted: venation"),
        ({"maps": {"water": 1.5}}, "maps: water: value 1.5"),
        ({"maps": {"water": float("nan")}}, "maps: water: value nan"),
        ({"maps": {"source": 0.5}}, "maps: source: value 0.5"),
        ({"maps": {"water": Path("nowhere.png")}}, "nowhere.png: no such file"),
        ({"mask": Path("nowhere.png")}, "nowhere.png: no such file"),
    ],
)
def test_bad_arguments(image: Path, arguments: dict, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        prepared(image, **{"length": LENGTH, "vertices": 100, "map_size": (16, 16), **arguments})
    assert "\n" not in str(caught.value)


def test_cache(image: Path, tmp_path: Path, analysis_anew) -> None:
    asked = dict(length=LENGTH, vertices=60, map_size=(24, 36), maps=AUTO, cache=tmp_path / "cache")
    first = prepared(image, **asked)
    (stored,) = (tmp_path / "cache").iterdir()
    whole = stored.read_bytes()
    assert_same(first, prepared(image, **asked))
    assert stored.read_bytes() == whole
    assert load_leaf(stored) is not None
    for damaged in (whole[: len(whole) // 2], b"", whole[:5000] + b"\0" * 64 + whole[5064:]):
        stored.write_bytes(damaged)
        assert load_leaf(stored) is None
    assert_same(first, prepared(image, **asked))
    assert len(stored.read_bytes()) == len(whole)
    other = prepared(image, **{**asked, "map_size": (24, 35)})
    assert other.mask.shape == (35, 24) and len(list((tmp_path / "cache").iterdir())) == 2


def test_cache_sees_a_changed_map_image(image: Path, tmp_path: Path) -> None:
    asked = dict(length=LENGTH, vertices=100, map_size=(12, 12), cache=tmp_path / "cache")
    path = tmp_path / "water.png"
    for value in (51, 204):
        write_image(path, np.full((HEIGHT, WIDTH), value, np.uint8))
        leaf = prepared(image, maps={"water": path}, **asked)
        np.testing.assert_allclose(leaf.maps["water"][leaf.mask], value / 255.0)


def test_cache_folder_that_cannot_be_made(image: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    assert prepared(image, length=LENGTH, vertices=100, map_size=None, cache=tmp_path / "file").length == LENGTH


def test_warm_load_imports_none_of_the_heavy_libraries(image: Path, tmp_path: Path) -> None:
    prepared(image, length=LENGTH, vertices=100, map_size=(8, 8), maps=AUTO, cache=tmp_path)
    program = (
        "import sys; from pathlib import Path; from leafwarp.leaf import LeafRequest, prepare_leaf\n"
        f"prepare_leaf(LeafRequest(Path({str(image)!r}), length={LENGTH}, vertices=100, map_size=(8, 8), "
        f"maps={AUTO!r}), Path({str(tmp_path)!r}))\n"
        "print(sorted({'cv2', 'netgen', 'scipy', 'trimesh'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    assert len(list(tmp_path.glob("*.npz"))) == 1
