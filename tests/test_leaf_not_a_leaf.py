"""What is not a leaf is refused, leaves of all colours are not, and leaves beside the leaf are counted."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from leaf_forms import draw, simple, with_stalk
from leaf_photos import leaf_photo
from leafwarp.errors import InputError
from leafwarp.leaf.image.photo import Photo
from leafwarp.leaf.segment.likeness import ROUND_LEAF, Evidence, evidence
from leafwarp.leaf.segment.silhouette import LEAST_CONFIDENCE, Silhouette, silhouette

SIDE = 300  # [pixels]
SMALL = 220  # [pixels] where many are tried
FIRM = 0.1  # by how much the confidence in a leaf, or in something else, is away from the level


def find(colour: np.ndarray, alpha: np.ndarray | None = None, **arguments) -> Silhouette:
    return silhouette(Photo(Path("thing.png"), np.ascontiguousarray(colour), alpha), **arguments)


def grainy(picture: np.ndarray) -> np.ndarray:
    noise = np.random.default_rng(3).normal(0.0, 2.0, (*picture.shape[:2], 1))
    return np.clip(cv2.GaussianBlur(picture.astype(float), (0, 0), 0.7) + noise, 0, 255).astype(np.uint8)


def place() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Right and down from the middle and the distance from it, 1 at the nearest side."""
    y, x = (np.mgrid[:SIDE, :SIDE] + 0.5) / (0.5 * SIDE) - 1.0
    return x, y, np.hypot(x, y)


def painted(ground: tuple, inside: np.ndarray, colour: np.ndarray | tuple) -> np.ndarray:
    return np.where(inside[..., None], np.array(colour, float), np.array(ground, float))


def retina() -> np.ndarray:
    """An orange disc on black with a net of dark vessels."""
    away = place()[2]
    picture = painted((4, 4, 5), away < 0.9, (200, 95, 50))
    for turn in np.linspace(0.2, 5.8, 9):
        line = [
            (int(150 + 130 * s * np.cos(turn + s)), int(150 + 130 * s * np.sin(turn + s))) for s in (0, 0.4, 0.7, 1)
        ]
        cv2.polylines(picture, [np.array(line)], False, (150.0, 45.0, 30.0), 2, cv2.LINE_AA)
    return np.where(away[..., None] < 0.9, picture, 4.0)


def moon() -> np.ndarray:
    x, y, away = place()
    craters = 12.0 * np.sin(9.0 * x + 5.0 * y) * np.sin(7.0 * y - 3.0 * x)
    return painted((12, 12, 12), away < 0.55, (185.0 + craters)[..., None] * np.ones(3))


def colour_wheel() -> np.ndarray:
    x, y, away = place()
    hsv = np.dstack([np.arctan2(y, x) * 90.0 / np.pi + 90.0, np.minimum(away * 255.0, 255.0), np.full_like(x, 230.0)])
    wheel = cv2.cvtColor(np.clip(hsv, 0, (179, 255, 255)).astype(np.uint8), cv2.COLOR_HSV2RGB)
    return painted((10, 10, 10), away < 0.8, wheel)


def rocket() -> np.ndarray:
    """A tall lit thing that stands on the lower border of a dusky picture."""
    x, y, _ = place()
    body = (np.abs(x) < 0.12) & (y > -0.7) | (np.abs(x) < 0.12 * (y + 0.95) / 0.25) & (y <= -0.7) & (y > -0.95)
    body |= (np.abs(x) < 0.4) & (y > 0.8)
    lit = 0.55 + 0.45 * np.clip(1.0 - 5.0 * np.abs(x + 0.06), -0.6, 1.0)
    return painted((38, 44, 66), body, lit[..., None] * np.array((235, 210, 160)))


def hand(skin: tuple[int, int, int] = (222, 172, 146)) -> np.ndarray:
    """Palm, five fingers and the wrist, which the lower border cuts."""
    shape = np.zeros((SIDE, SIDE), np.uint8)
    cv2.ellipse(shape, (150, 185), (52, 58), 0, 0, 360, 1, -1)
    cv2.rectangle(shape, (115, 190), (185, SIDE), 1, -1)
    for x, top, foot in ((112, 75, 165), (137, 45, 150), (162, 50, 150), (187, 80, 165)):
        cv2.line(shape, (x, top), (x - (x - 150) // 5, foot), 1, 22)
    cv2.line(shape, (232, 140), (185, 205), 1, 24)
    depth = cv2.distanceTransform(shape, cv2.DIST_L2, 5)
    return painted((235, 234, 230), shape > 0, np.clip(0.85 + 0.01 * depth, 0, 1)[..., None] * np.array(skin, float))


def coin() -> np.ndarray:
    x, y, away = place()
    rim = 1.0 + 0.15 * ((away > 0.52) | (np.abs(np.sin(6.0 * x) * np.cos(5.0 * y)) > 0.8))
    return painted((238, 237, 232), away < 0.6, rim[..., None] * np.array((178, 138, 62)))


def card() -> np.ndarray:
    x, y, _ = place()
    return painted((60, 60, 64), (np.abs(x) < 0.7) & (np.abs(y) < 0.45), (215, 205, 120))


def cup() -> np.ndarray:
    x, y, _ = place()
    body = (np.abs(x) < 0.4 - 0.1 * y) & (np.abs(y) < 0.5) | (np.abs(np.hypot(x - 0.42, y) - 0.22) < 0.06)
    return painted((120, 84, 60), body, (246, 245, 243))


THINGS = {thing.__name__: thing for thing in (retina, moon, colour_wheel, rocket, hand, coin, card, cup)}


@pytest.mark.parametrize("name", THINGS)
def test_a_photo_of_something_else_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=r"^thing.png: no (leaf found|background found)[^\n]*; accepted: [^\n]*$"):
        find(grainy(THINGS[name]()))


@pytest.mark.parametrize(("name", "why"), [("coin", "round as a disc"), ("cup", "white"), ("card", "a rectangle")])
def test_the_refusal_says_why(name: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        find(grainy(THINGS[name]()))


COLOURS = {
    "green": (70, 120, 45),
    "dark": (40, 60, 30),
    "pale": (200, 205, 150),
    "yellow": (215, 185, 50),
    "orange": (215, 120, 40),
    "red": (165, 45, 35),
    "wine": (110, 40, 60),
    "brown": (125, 85, 50),
    "tan": (165, 125, 80),
}


@pytest.mark.parametrize(
    "gains", [(1.0, 1.0, 1.0), (0.85, 1.0, 1.15), (1.15, 1.0, 0.85)], ids=["plain", "cool", "warm"]
)
@pytest.mark.parametrize("name", COLOURS)
def test_a_leaf_of_any_colour_is_a_leaf(name: str, gains: tuple[float, float, float]) -> None:
    truth = leaf_photo("grey", 5, side=SMALL, colour=COLOURS[name])
    shape = find(np.clip(truth.colour * np.array(gains), 0, 255).astype(np.uint8))
    assert shape.confidence > LEAST_CONFIDENCE + FIRM
    assert np.count_nonzero(shape.inside ^ truth.leaf) < 0.04 * np.count_nonzero(truth.leaf)


def test_a_broad_leaf_is_no_disc() -> None:
    assert find(draw(simple(widest=0.5, width=0.95), 20.0, pixels=220.0).picture).confidence > 0.9
    assert find(draw(with_stalk(simple(widest=0.5, width=1.0)), 20.0, pixels=220.0).picture).confidence > 0.9


def test_a_round_leaf_is_taken_with_less_confidence() -> None:
    """Pennywort and nasturtium are as round as a coin, but green."""
    x, y, _ = place()
    round_leaf = painted((246, 245, 243), np.hypot(x, y) < 0.6, (70, 120, 45))
    shape = find(grainy(round_leaf))
    assert LEAST_CONFIDENCE < shape.confidence <= ROUND_LEAF
    assert shape.notes == ("confidence 0.70: it is as round as a disc; a leaf all the same?",)


@pytest.mark.parametrize("name", ["colour_wheel", "coin", "card", "cup"])
def test_opacity_does_not_make_an_icon_a_leaf(name: str) -> None:
    """The same icon is accepted where a person gives its shape as the leaf's mask."""
    picture = THINGS[name]()
    alpha = np.where(np.abs(picture - picture[0, 0]).sum(axis=2) > 12.0, 255, 0).astype(np.uint8)
    with pytest.raises(InputError, match=r"^thing.png: opacity: what it shows does not look like a leaf \(confidence"):
        find(grainy(picture), alpha)
    assert find(grainy(picture), alpha, mask=alpha / np.float32(255.0)).confidence == 1.0


@pytest.mark.parametrize("name", COLOURS)
def test_a_leaf_that_was_cut_out_is_one(name: str) -> None:
    truth = leaf_photo("white", 6, side=SMALL, colour=COLOURS[name])
    alpha = np.where(truth.leaf, 255, 0).astype(np.uint8)
    shape = find(truth.colour, alpha)
    assert shape.confidence > 0.9 and not shape.notes
    np.testing.assert_array_equal(shape.inside, truth.leaf)
    # What colour an editor leaves in transparent pixels says nothing.
    assert find(np.where(truth.leaf[..., None], truth.colour, (0, 0, 255)).astype(np.uint8), alpha).confidence > 0.9


def test_leaves_beside_the_leaf_are_counted() -> None:
    large = leaf_photo("white", 1, side=SIDE, shadow=0.2)
    others = [
        leaf_photo("white", 2, side=SIDE, shadow=0.2, size=0.16, colour=(170, 50, 40)),
        leaf_photo("white", 3, side=SIDE, shadow=0.2, size=0.2, colour=(150, 120, 40)),
    ]
    for count in (1, 2):
        shape = find(np.hstack([large.colour, *(other.colour for other in others[:count])]))
        assert [note for note in shape.notes if f"{count + 1} leaves seen, the largest is taken" in note]
        assert not shape.inside[:, SIDE:].any()


def test_a_hand_and_a_coin_beside_a_leaf_are_no_leaves() -> None:
    leaf = leaf_photo("white", 1, side=SIDE, shadow=0.2).colour
    beside = [cv2.resize(thing(), (200, 200), interpolation=cv2.INTER_AREA) for thing in (hand, coin)]
    beside = [cv2.copyMakeBorder(thing, SIDE - 200, 0, 0, 0, cv2.BORDER_REPLICATE) for thing in beside]
    shape = find(np.hstack([leaf, *(grainy(thing) for thing in beside)]))
    assert not [note for note in shape.notes if "leaves seen" in note]
    assert not shape.inside[:, SIDE:].any()


def test_more_evidence_never_makes_a_thing_more_of_a_leaf() -> None:
    """A green thing turns blue pixel by pixel, and one off green runs off the picture more and more."""
    inside = np.zeros((80, 120), bool)
    inside[20:60, 20:90] = True
    cv2.fillConvexPoly(shape := inside.astype(np.uint8), np.array([[20, 20], [90, 20], [20, 60]]), 0)
    inside = shape > 0
    green, blue, brown = ((50.0, -35.0, 35.0), (50.0, 10.0, -40.0), (50.0, 15.0, 30.0))
    likeness = []
    for share in np.linspace(0.0, 1.0, 21):
        lab = np.where((np.random.default_rng(0).random(inside.shape) < share)[..., None], blue, green)
        likeness.append(evidence(lab.astype(np.float32), inside, False, 0.0).likeness)
    assert likeness[0] == 1.0 and likeness[-1] < LEAST_CONFIDENCE and (np.diff(likeness) <= 0.0).all()
    lab = np.broadcast_to(np.array(brown, np.float32), (*inside.shape, 3))
    cut = [evidence(lab, inside, False, share).likeness for share in np.linspace(0.0, 0.4, 21)]
    assert cut[0] == 1.0 and cut[-1] > LEAST_CONFIDENCE and (np.diff(cut) <= 0.0).all()


def test_evidence_is_named_strongest_first() -> None:
    seen = Evidence((("white", 0.8), ("round", 0.4), ("red", 1.0)))
    assert seen.against == "round, white" and seen.likeness == pytest.approx(0.32)
