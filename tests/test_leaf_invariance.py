"""Turning, mirroring, rescaling, recompressing or recolouring a photo changes neither the leaf's area nor its base."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

import real_leaves
from leaf_forms import draw, lobed, simple, with_stalk
from leafwarp.leaf.image.photo import Photo, read_photo
from leafwarp.leaf.segment.silhouette import silhouette
from leafwarp.leaf.shape.outline import Outline, find_outline

SAME = 0.03  # of the area, and of the leaf's length
SIDE = 800  # [pixels] of a real photo: it is shrunk to that before it is changed

Place = Callable[[np.ndarray], np.ndarray]  # where a point of the photo is in the changed one
Change = Callable[[np.ndarray], tuple[np.ndarray, Place, float]]  # the picture, that, and its scale


def turned(picture: np.ndarray) -> tuple[np.ndarray, Place, float]:
    width = picture.shape[1]
    return np.rot90(picture).copy(), lambda point: np.array([point[1], width - point[0]]), 1.0


def turned_by_33_degrees(picture: np.ndarray) -> tuple[np.ndarray, Place, float]:
    height, width = picture.shape[:2]
    cosine, sine = np.cos(np.deg2rad(33.0)), np.sin(np.deg2rad(33.0))
    size = (int(width * cosine + height * sine) + 1, int(width * sine + height * cosine) + 1)
    matrix = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0]])
    matrix[:, 2] = 0.5 * np.array(size) - matrix[:, :2] @ (0.5 * width, 0.5 * height)
    centres = matrix.copy()  # OpenCV counts from the first pixel's centre
    centres[:, 2] += matrix[:, :2] @ (0.5, 0.5) - 0.5
    paper = cv2.BORDER_REPLICATE
    return (
        cv2.warpAffine(picture, centres, size, flags=cv2.INTER_CUBIC, borderMode=paper),
        lambda point: matrix[:, :2] @ point + matrix[:, 2],
        1.0,
    )


def mirrored(picture: np.ndarray) -> tuple[np.ndarray, Place, float]:
    width = picture.shape[1]
    return picture[:, ::-1].copy(), lambda point: np.array([width - point[0], point[1]]), 1.0


def turned_mirror_image(picture: np.ndarray) -> tuple[np.ndarray, Place, float]:
    return picture.swapaxes(0, 1).copy(), lambda point: point[::-1], 1.0


def scaled(factor: float) -> Change:
    def change(picture: np.ndarray) -> tuple[np.ndarray, Place, float]:
        size = tuple(round(factor * side) for side in picture.shape[1::-1])
        way = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_CUBIC
        return cv2.resize(picture, size, interpolation=way), lambda point: factor * point, factor

    return change


def recompressed(picture: np.ndarray) -> tuple[np.ndarray, Place, float]:
    stored = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 60])[1]
    return cv2.imdecode(stored, cv2.IMREAD_COLOR)[..., ::-1].copy(), lambda point: point, 1.0


def recoloured(*gains: float) -> Change:
    def change(picture: np.ndarray) -> tuple[np.ndarray, Place, float]:
        return np.clip(np.rint(picture * np.array(gains)), 0, 255).astype(np.uint8), lambda point: point, 1.0

    return change


def turned_mirror_image_recompressed(picture: np.ndarray) -> tuple[np.ndarray, Place, float]:
    changed, place, scale = turned_mirror_image(picture)
    return recompressed(changed)[0], place, scale


CHANGES: dict[str, Change] = {
    "turned": turned,
    "mirrored": mirrored,
    "half": scaled(0.5),
    "double": scaled(2.0),
    "JPEG 60": recompressed,
    "warm": recoloured(1.06, 1.0, 0.88),
    "cool": recoloured(0.88, 1.0, 1.06),
}
DRAWN = {
    "pinnate": draw(simple(teeth=12), 25.0, pixels=180.0),
    "pinnate, stalked": draw(with_stalk(simple(widest=0.35)), 70.0, pixels=180.0),
    "lobed": draw(lobed(), 150.0, pixels=300.0),
    "heart, red stalk": draw(with_stalk(simple(heart=0.2), bend=0.8), 0.0, pixels=440.0, stalk_colour=(150, 60, 70)),
}


def area(points: np.ndarray) -> float:
    x, y = points.T
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))


def outline_of(picture: np.ndarray) -> Outline:
    photo = Photo(Path("leaf.jpg"), picture, None)
    return find_outline(photo, silhouette(photo))


@cache
def drawn_outline(name: str) -> Outline:
    return outline_of(DRAWN[name].picture)


@cache
def real_picture(name: str) -> np.ndarray:
    picture = read_photo(real_leaves.FOLDER / f"{name}.jpg").colour
    shrink = min(1.0, SIDE / max(picture.shape))
    return cv2.resize(picture, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)


@cache
def real_outline(name: str) -> Outline:
    return outline_of(real_picture(name))


def assert_same(before: Outline, picture: np.ndarray, change: Change) -> None:
    changed, place, scale = change(picture)
    after = outline_of(changed)
    assert area(after.points) == pytest.approx(area(before.points) * scale**2, rel=SAME)
    assert np.linalg.norm(after.base - place(before.base)) < SAME * scale * before.length


@pytest.mark.parametrize("name", DRAWN)
def test_drawn_leaf_is_found(name: str) -> None:
    drawn = DRAWN[name]
    outline = drawn_outline(name)
    assert area(outline.points) == pytest.approx(drawn.cover.sum(), rel=SAME)
    assert np.linalg.norm(outline.base - drawn.base) < SAME * drawn.length


def dealt(names: Iterable[str], changes: tuple[str, ...], hands: int) -> list:
    """Every leaf with every change: those of a leaf's turn, one of so many, always, and the others with --slow."""
    return [
        pytest.param(name, change, marks=[] if (index - turn) % hands == 0 else pytest.mark.slow)
        for index, name in enumerate(names)
        for turn, change in enumerate(changes)
    ]


@pytest.mark.parametrize("name, change", dealt(DRAWN, (*CHANGES, "33 degrees"), 2))
def test_drawn_leaf_is_the_same(name: str, change: str) -> None:
    assert_same(drawn_outline(name), DRAWN[name].picture, CHANGES.get(change, turned_by_33_degrees))


REAL_CHANGES: dict[str, Change] = {
    "turned mirror image, JPEG 60": turned_mirror_image_recompressed,
    "half": scaled(0.5),
    "double": scaled(2.0),
    "warm": CHANGES["warm"],
}


@pytest.mark.parametrize("name, change", dealt(real_leaves.BASES, ("turned mirror image, JPEG 60", "size", "warm"), 3))
def test_real_leaf_is_the_same(name: str, change: str) -> None:
    if name not in real_leaves.present():
        pytest.skip("the photo is not beside the repository")
    picture = real_picture(name)
    if change == "size":
        change = "half" if max(picture.shape) > 400 else "double"
    assert_same(real_outline(name), picture, REAL_CHANGES[change])
