"""The leaf found in drawn photos over all backgrounds, what is refused, and what must not change it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from leaf_forms import draw, simple, with_stalk
from leaf_photos import BACKGROUNDS, OTHER_THINGS, LeafPhoto, leaf_photo, other_thing
from leafwarp.errors import InputError
from leafwarp.leaf.image.photo import Photo
from leafwarp.leaf.segment.background import Background
from leafwarp.leaf.segment.refine import cleaned
from leafwarp.leaf.segment.shadow import without_shadow
from leafwarp.leaf.segment.silhouette import LEAST_CONFIDENCE, Silhouette, silhouette

LEAST_AGREEMENT = 0.97  # of leaf and truth: half a pixel along a serrated margin of these small pictures is 1-2 %
LEAST_PETIOLE = 0.9  # of the petiole's pixels; its rim is lost to blur
AREA_CHANGE = 0.03  # that turning, scaling, compressing or tinting a photo may make
REAL = Path(__file__).parents[2] / "shared" / "leaves"
needs_real = pytest.mark.skipif(not REAL.is_dir(), reason="the real photos are not here")
REAL_LEAVES = (
    "corn_gls", "grape_esca", "grapevine", "leafcalc1", "poplar", "potato_hole", "raspberry", "squash", "zelkova",
)  # fmt: skip


def find(colour: np.ndarray, **arguments) -> Silhouette:
    return silhouette(Photo(Path("leaf.png"), np.ascontiguousarray(colour), None), **arguments)


def refusal(colour: np.ndarray, **arguments) -> str:
    with pytest.raises(InputError) as caught:
        find(colour, **arguments)
    message = str(caught.value)
    assert message.startswith("leaf.png: ") and "accepted: " in message and "\n" not in message
    return message


def agreement(first: np.ndarray, second: np.ndarray) -> float:
    """Intersection over union."""
    return np.count_nonzero(first & second) / np.count_nonzero(first | second)


def assert_found(shape: Silhouette, truth: LeafPhoto) -> None:
    assert shape.confidence >= LEAST_CONFIDENCE
    assert agreement(shape.inside, truth.leaf) >= LEAST_AGREEMENT
    assert np.count_nonzero(shape.inside & truth.petiole) >= LEAST_PETIOLE * np.count_nonzero(truth.petiole)


def area(shape: Silhouette) -> float:
    """Area in pixels of the photo."""
    return np.count_nonzero(shape.inside) * shape.scale[0] * shape.scale[1]


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("background", BACKGROUNDS)
def test_every_background(background: str, seed: int) -> None:
    truth = leaf_photo(background, 10 * seed + BACKGROUNDS.index(background))
    shape = find(truth.colour)
    assert_found(shape, truth)
    assert shape.holes is None or background == "wood"  # a brown spot on brown wood cannot be told from a hole
    assert shape.field.dtype == np.float32 and np.abs(shape.field).max() <= 1.0


@pytest.mark.parametrize("background", BACKGROUNDS)
def test_hole_glare_and_scale_bar(background: str) -> None:
    truth = leaf_photo(background, 20 + BACKGROUNDS.index(background), glare=True, hole=True, ruler=True, spots=0)
    shape = find(truth.colour)
    assert_found(shape, truth)
    assert shape.holes is not None
    assert agreement(shape.holes, truth.hole) > 0.8  # the hole is 25 pixels wide: a pixel around it is 15 %


@pytest.mark.parametrize("colour", [(185, 170, 60), (150, 50, 35), (120, 85, 50), (40, 60, 30)])
@pytest.mark.parametrize("background", ["white", "grey"])
def test_yellow_red_brown_and_dark_leaves(background: str, colour: tuple[int, int, int]) -> None:
    truth = leaf_photo(background, 5, colour=colour, spots=0)
    assert_found(find(truth.colour), truth)


@pytest.mark.parametrize("shadow", [0.6, 0.8])
def test_hard_shadow_is_not_leaf(shadow: float) -> None:
    truth = leaf_photo("grey", 9, shadow=shadow)
    assert_found(find(truth.colour), truth)


@pytest.mark.parametrize("background", ["white", "grey", "black"])
def test_compound_leaf_stays_one(background: str) -> None:
    truth = leaf_photo(background, 12, leaflets=3, spots=0)
    assert_found(find(truth.colour), truth)


@pytest.mark.parametrize(("side", "size"), [(256, 0.3), (700, 0.1), (1100, 0.3)])
def test_sizes(side: int, size: float) -> None:
    truth = leaf_photo("white", 3, side=side, size=size)
    shape = find(truth.colour)
    assert max(shape.field.shape) <= 1024
    whole = cv2.resize(shape.field, truth.leaf.shape[::-1], interpolation=cv2.INTER_LINEAR) > 0.0
    assert agreement(whole, truth.leaf) >= LEAST_AGREEMENT


def test_grey_picture() -> None:
    truth = leaf_photo("white", 4, shadow=0.1)
    grey = cv2.cvtColor(truth.colour, cv2.COLOR_RGB2GRAY)
    assert agreement(find(np.dstack([grey] * 3)).inside, truth.leaf) >= LEAST_AGREEMENT


@pytest.mark.parametrize("kind", OTHER_THINGS)
def test_other_things_are_refused(kind: str) -> None:
    for seed in range(2):
        assert "found" in refusal(other_thing(kind, side=240, seed=seed))


def test_two_leaves_and_the_rectangle_that_picks_one() -> None:
    large, small = leaf_photo("white", 1, shadow=0.2), leaf_photo("white", 2, size=0.22, shadow=0.2)
    both = np.hstack([large.colour, small.colour])
    shape = find(both)
    assert agreement(shape.inside[:, :400], large.leaf) >= LEAST_AGREEMENT and not shape.inside[:, 400:].any()
    assert any("2 leaves seen, the largest is taken: leaf.rect" in note for note in shape.notes)
    shape = find(both, rect=(400, 0, 400, 400))
    assert shape.inside.shape == both.shape[:2]
    assert agreement(shape.inside[:, 400:], small.leaf) >= LEAST_AGREEMENT and not shape.inside[:, :400].any()
    assert not shape.notes


@pytest.mark.parametrize("rect", [(0, 0, 5, 5), (390, 10, 300, 300), (0, 0, np.nan, 20), (0, 0, 100), (-50, 0, 60, 90)])
def test_rectangle_off_the_photo_is_refused(rect: tuple) -> None:
    assert "rect: value" in refusal(leaf_photo("white", 1).colour, rect=rect)


def test_leaf_that_is_cut_by_the_picture() -> None:
    truth = leaf_photo("white", 1, shadow=0.2, size=0.32)
    rows, columns = np.nonzero(truth.leaf)
    part = truth.colour[:, : int(columns.min() + 0.75 * np.ptp(columns))]
    shape = find(part)
    assert any("outline lies on the picture's border" in note for note in shape.notes)
    assert agreement(shape.inside, truth.leaf[:, : part.shape[1]]) >= LEAST_AGREEMENT
    middle = truth.colour[int(rows.mean()) - 40 : int(rows.mean()) + 40, int(columns.mean()) - 40 :][:, :80]
    assert "found" in refusal(middle)


def test_opacity_and_mask() -> None:
    truth = leaf_photo("white", 6, hole=True, spots=0)
    opacity = np.where(truth.leaf & ~truth.hole, 255, 0).astype(np.uint8)
    shape = silhouette(Photo(Path("leaf.png"), truth.colour, opacity))
    assert shape.confidence == 1.0 and not shape.notes
    np.testing.assert_array_equal(shape.inside, truth.leaf)
    np.testing.assert_array_equal(shape.holes, truth.hole)
    with pytest.raises(InputError, match=r"leaf.png: opacity: no leaf in it"):
        silhouette(Photo(Path("leaf.png"), truth.colour, np.zeros_like(opacity)))
    with pytest.raises(InputError, match=r"m.png: mask: no leaf in it"):
        find(truth.colour, mask=np.zeros((40, 40)), mask_path=Path("m.png"))
    with pytest.raises(InputError, match=r"m.png: mask: all of it is leaf"):
        find(truth.colour, mask=np.ones((40, 40)), mask_path=Path("m.png"))


def turned(colour: np.ndarray, degrees: float) -> np.ndarray:
    """A picture turned, the corners filled with the colour of its border."""
    height, width = colour.shape[:2]
    side = int(np.hypot(height, width)) + 2
    turn = cv2.getRotationMatrix2D((width / 2, height / 2), degrees, 1.0)
    turn[:, 2] += ((side - width) / 2, (side - height) / 2)
    ground = [float(value) for value in np.median(np.concatenate([colour[0], colour[-1]]), axis=0)]
    return cv2.warpAffine(colour, turn, (side, side), borderMode=cv2.BORDER_CONSTANT, borderValue=ground)


def compressed(colour: np.ndarray, quality: int) -> np.ndarray:
    return cv2.imdecode(cv2.imencode(".jpg", colour, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR)


def rescaled(colour: np.ndarray, factor: float) -> np.ndarray:
    way = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_CUBIC
    return cv2.resize(colour, None, fx=factor, fy=factor, interpolation=way)


def tinted(colour: np.ndarray, gains: tuple[float, float, float]) -> np.ndarray:
    return np.clip(colour * np.array(gains), 0, 255).astype(np.uint8)


CHANGES = {
    "turned 90": (lambda colour: np.rot90(colour), 1.0),
    "turned 180": (lambda colour: np.rot90(colour, 2), 1.0),
    "turned 37": (lambda colour: turned(colour, 37.0), 1.0),
    "mirrored": (lambda colour: colour[:, ::-1], 1.0),
    "halved": (lambda colour: rescaled(colour, 0.5), 0.25),
    "doubled": (lambda colour: rescaled(colour, 2.0), 4.0),
    "JPEG 60": (lambda colour: compressed(colour, 60), 1.0),
    "warmer": (lambda colour: tinted(colour, (1.15, 1.0, 0.85)), 1.0),
    "colder": (lambda colour: tinted(colour, (0.85, 1.0, 1.15)), 1.0),
    "greener": (lambda colour: tinted(colour, (0.85, 1.15, 0.85)), 1.0),
}


@cache
def drawn_and_area(background: str) -> tuple[np.ndarray, float]:
    colour = leaf_photo(background, 31, side=260).colour
    return colour, area(find(colour))


@pytest.mark.parametrize("background", ["white", "grey", "wood"])
@pytest.mark.parametrize("name", CHANGES)
def test_a_changed_photo_shows_the_same_leaf(name: str, background: str) -> None:
    colour, before = drawn_and_area(background)
    change, factor = CHANGES[name]
    assert area(find(change(colour))) == pytest.approx(factor * before, rel=AREA_CHANGE)


def real_photo(name: str, side: int = 320) -> np.ndarray:
    colour = cv2.cvtColor(cv2.imread(str(REAL / f"{name}.jpg")), cv2.COLOR_BGR2RGB)
    return rescaled(colour, side / max(colour.shape)) if max(colour.shape) > side else colour


@needs_real
@pytest.mark.parametrize("name", REAL_LEAVES)
def test_a_changed_real_photo_shows_the_same_leaf(name: str) -> None:
    """The changes that test_leaf_invariance does not make to these photos."""
    colour = real_photo(name)
    before = area(find(colour))
    changes = ["turned 37", "colder", "greener"]
    # Turned by 37 degrees a cut edge becomes outline, and graph paper a thing on a ground of another colour.
    if name in ("corn_gls", "grapevine", "potato_hole"):
        changes[0] = "turned 180"
    for label in changes:
        change, factor = CHANGES[label]
        assert area(find(change(colour))) == pytest.approx(factor * before, rel=AREA_CHANGE), label


@needs_real
def test_a_leaf_that_fills_the_photo_is_refused() -> None:
    colour = real_photo("corn_full")
    for label in ("turned 90", "halved", "JPEG 60", "warmer", "colder", "greener"):
        assert "found" in refusal(CHANGES[label][0](colour)), label


@pytest.mark.parametrize("vein", [(92, 165, 75), (150, 190, 120)])
def test_the_veins_of_a_leaf_that_fills_the_photo_are_no_leaf(vein: tuple[int, int, int]) -> None:
    """Green on green, lighter and of the same or of less colour; midrib and side veins run from border to border."""
    picture = np.full((320, 400, 3), (66, 125, 50), np.float32)
    grain = np.random.default_rng(4).normal(0.0, 12.0, (320, 400)).astype(np.float32)
    picture += cv2.GaussianBlur(grain, (0, 0), 6.0)[..., None] * 5.0
    cv2.line(picture, (200, -10), (200, 330), vein, 8, cv2.LINE_AA)
    for foot in range(0, 480, 60):
        for end in (-10, 410):
            cv2.line(picture, (200, foot), (end, foot - 70), vein, 4, cv2.LINE_AA)
    message = refusal(np.clip(picture, 0.0, 255.0).astype(np.uint8))
    assert "a leaf seems to fill the picture" in message or "no leaf found for sure" in message


def test_a_stalk_that_the_margin_cut_off_at_its_foot_is_joined_again() -> None:
    """As where a small picture blurs the foot of a thin petiole."""
    leaf = np.zeros((120, 90), bool)
    leaf[10:70, 15:75] = True
    leaf[70:110, 43:47] = True
    field = np.where(leaf, 1.0, -1.0).astype(np.float32)
    field[67:74, 40:50] = -0.2
    inside = cleaned(field, leaf) > 0.0
    assert inside[109, 44] and inside[72, 43:47].any()
    assert not inside[72, :42].any() and not inside[72, 48:].any()


def test_a_petiole_that_leaves_the_picture_is_noted() -> None:
    picture = np.full((320, 300, 3), 240, np.uint8)
    cv2.ellipse(picture, (150, 130), (80, 110), 0, 0, 360, (60, 120, 50), -1, cv2.LINE_AA)
    whole = picture.copy()
    for end, shown in ((330, picture), (305, whole)):
        cv2.line(shown, (150, 235), (150, end), (70, 130, 60), 4, cv2.LINE_AA)
    assert any("runs up to the picture's border" in note for note in find(picture).notes)
    assert not find(whole).notes


def test_a_thread_at_the_margin_is_no_second_petiole() -> None:
    """A dark scratch that runs from the tip, opposite to the petiole, away from it."""
    truth = leaf_photo("white", 1, shadow=0.2, spots=0)
    where = np.argwhere(truth.leaf)
    foot = np.argwhere(truth.petiole).mean(axis=0)
    tip = where[np.argmax(np.linalg.norm(where - foot, axis=1))].astype(float)
    end = tip + 60.0 * (tip - foot) / np.linalg.norm(tip - foot)
    colour = truth.colour.copy()
    cv2.line(colour, *(tuple(np.rint(place[::-1]).astype(int).tolist()) for place in (tip, end)), (90, 80, 110), 1)
    shape = find(colour)
    assert_found(shape, truth)
    near = cv2.dilate(truth.leaf.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    assert not (shape.inside & ~near).any()


def test_thin_tips_of_pinnae_are_kept() -> None:
    """They are narrower than what the first look at half the size can show."""
    leaf = np.zeros((2000, 1800), np.uint8)  # at twice the picture's size
    cv2.line(leaf, (900, 1900), (900, 120), 255, 18)
    for height in range(240, 1500, 75):
        for side in (-1, 1):
            tip = (900 + side * 600, height - 120)
            cv2.fillPoly(
                leaf,
                [np.array([(900, height - 24), (tip[0], tip[1] - 3), (tip[0], tip[1] + 3), (900, height + 24)])],
                255,
            )
    cover = cv2.resize(leaf, (900, 1000), interpolation=cv2.INTER_AREA)[..., None] / 255.0
    grain = np.random.default_rng(3).normal(0.0, 2.0, (1000, 900, 1))
    picture = (244, 243, 238) * (1.0 - cover) + (70, 125, 50) * cover + grain
    shape = find(np.clip(picture, 0, 255).astype(np.uint8))
    truth = cover[..., 0] > 0.5
    assert shape.inside.shape == truth.shape
    for half in (np.s_[:, :450], np.s_[:, 450:]):
        rows, columns = np.nonzero(truth[half])
        off_axis = np.abs(columns - (449 if half[1].start is None else 0))
        outer = off_axis > 0.75 * off_axis.max()  # the last quarter of the pinnae
        assert np.count_nonzero(shape.inside[half][rows[outer], columns[outer]]) > 0.9 * np.count_nonzero(outer)
    # The axils of the pinnae, half a degree wide at their ends, are rounded.
    assert agreement(shape.inside, truth) > 0.93


@pytest.mark.parametrize("colour", [(35, 35, 40), (120, 85, 60)])
@pytest.mark.parametrize("inner", [-2.0, -65.0, -250.0])
def test_a_thread_on_a_blade_without_a_petiole_is_none(inner: float, colour: tuple[int, int, int]) -> None:
    """It begins at the margin, on the blade, or on its other side, off the midrib; a petiole as thin is kept."""
    drawn = draw(simple(teeth=14, pairs=9), 40.0, pixels=260.0)
    pad = 80
    picture = cv2.copyMakeBorder(drawn.picture, pad, pad, pad, pad, cv2.BORDER_REPLICATE)
    leaf = np.pad(drawn.cover > 0.5, pad)
    middle = np.argwhere(leaf).mean(axis=0)[::-1]
    way = np.array([np.cos(0.6), np.sin(0.6)])
    reach = next(r for r in range(1000) if not leaf[tuple((middle + r * way)[::-1].astype(int))])
    ends = [np.rint(16.0 * (middle + (reach + off) * way)).astype(int).tolist() for off in (inner, 80.0)]
    cv2.line(picture, *ends, colour, 1, cv2.LINE_AA, 4)
    shape = find(cv2.GaussianBlur(picture, (0, 0), 0.6))
    near = cv2.dilate(leaf.astype(np.uint8), np.ones((11, 11), np.uint8)) > 0
    assert agreement(shape.inside, leaf) >= LEAST_AGREEMENT
    assert not (shape.inside & ~near).any()


def test_a_petiole_as_thin_as_a_thread_is_kept() -> None:
    drawn = draw(with_stalk(simple(teeth=14, pairs=9), 0.3, 0.008), 40.0, pixels=260.0)
    leaf = drawn.cover > 0.5
    shape = find(drawn.picture)
    assert agreement(shape.inside, leaf) >= LEAST_AGREEMENT
    assert np.linalg.norm(np.argwhere(shape.inside) - drawn.base[::-1], axis=1).min() < 4.0


def test_a_hole_over_deep_shadow_is_found_and_a_dark_spot_is_none() -> None:
    picture = np.full((300, 300, 3), (150, 150, 165), np.float32)
    truth = np.zeros((300, 300), np.uint8)
    cv2.ellipse(picture, (150, 150), (100, 120), 0, 0, 360, (110, 150, 70), -1)
    cv2.ellipse(truth, (110, 130), (20, 14), 0, 0, 360, 1, -1)
    picture[truth > 0] = (22, 20, 12)
    sunlit = truth * np.uint8(0)
    cv2.circle(sunlit, (126, 130), 7, 1, -1)
    picture[(sunlit & truth) > 0] = (170, 172, 184)
    cv2.circle(picture, (190, 170), 16, (38, 30, 20), -1)  # dead tissue through which no background shows
    picture = cv2.GaussianBlur(picture, (0, 0), 0.7) + np.random.default_rng(1).normal(0.0, 3.0, (300, 300, 1))
    shape = find(np.clip(picture, 0, 255).astype(np.uint8))
    assert shape.holes is not None
    assert agreement(shape.holes, truth > 0) > 0.8  # a pixel around it is 10 %


def test_a_dark_lesion_at_the_margin_is_no_shadow() -> None:
    inside = np.zeros((500, 500), bool)
    inside[100:400, 100:400] = True
    lab = np.zeros((500, 500, 3), np.float32)
    lab[:] = (75.0, 2.0, -4.0)
    lab[inside] = (55.0, -20.0, 35.0)
    shadow, lesion = np.zeros_like(inside), np.zeros_like(inside)
    shadow[380:400, 100:400] = True
    lesion[200:204, 100:118] = True
    lab[shadow | lesion] = (15.0, 2.0, 5.0)
    lit = without_shadow(lab, inside, Background(np.array([[75.0, 2.0, -4.0]], np.float32), 3.0, 1.0, False))
    assert lit[lesion].all() and not lit[shadow].any()
