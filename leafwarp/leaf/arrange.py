"""How many leaves differ from each other, and where they have their places."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from leafwarp.leaf.leaf import Leaf
from leafwarp.leaf.leaves import Leaves, gather_leaves
from leafwarp.leaf.specimen import Specimen
from leafwarp.scene.leaf import LeafTable
from leafwarp.scene.leaves import LeavesTable

GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))  # between successive leaves of most plants' spirals
STEM_SPACING = 0.25  # of the leaf's length
GRID_SPACING = 1.1  # of the least distance at which leaves cannot touch


def arrange_leaves(table: LeavesTable, photos: Sequence[Leaf], cambers: Sequence[LeafTable]) -> Leaves:
    """The leaves that a scene asks for, of its photos in turn.

    Args:
        table: What the scene says of them.
        photos: The prepared leaf of each photo, by whose axes they are turned and by whose extents they are spaced.
        cambers: What the scene says of each photo: the height of the camber, and its seed for leaves without their own.
    """
    spacing = table.spacing
    if spacing is None and table.arrangement == "stem":
        spacing = STEM_SPACING * max(photo.length for photo in photos)
    elif spacing is None:
        spacing = GRID_SPACING * least_spacing(table, photos)
    photo_of = [index % len(photos) for index in range(table.count)]
    axes = [axis_angle(photo) for photo in photos]
    specimens = [_specimen(table, index, axes[photo], spacing, cambers[photo]) for index, photo in enumerate(photo_of)]
    return gather_leaves(photos, photo_of, specimens)


def axis_angle(leaf: Leaf) -> float:
    """Angle of the axis from the petiole base to the farthest vertex, from the x axis [rad]."""
    tip = leaf.mesh.positions[np.argmax(np.linalg.norm(leaf.mesh.positions, axis=1))]
    return math.atan2(tip[1], tip[0])


def least_spacing(table: LeavesTable, photos: Sequence[Leaf]) -> float:
    """Distance of petiole bases [m] from which on no two leaves of a grid touch as they start, whatever they draw.

    Seen from above, a leaf lies in a circle whose centre is on its axis. The centre's way from the petiole base is as
    long as the size and the tilt make it and points where the turn has it. Two circles do not overlap once the bases
    are as far apart as both radii and the difference of the ways together. The difference is a convex function of the
    lengths of the ways, and grows or falls with the angle between them: the largest is at the ends of their ranges.

    Args:
        table: How much leaves differ.
        photos: The prepared leaf of each photo.
    """
    largest = 1.0 + table.size
    reach = math.cos(math.radians(table.tilt))
    shares = (reach * (largest if reach < 0.0 else 1.0 - table.size), largest)
    circles = [(axis_angle(photo), *_circle(photo)) for photo in photos]
    spacing = 0.0
    for one, other in itertools.combinations_with_replacement(circles, 2):
        between = abs(math.remainder(one[0] - other[0], 2.0 * math.pi))
        widest = min(math.pi, between + 2.0 * math.radians(table.turn))
        narrowest = max(0.0, between - 2.0 * math.radians(table.turn))
        for share, share_of_other, angle in itertools.product(shares, shares, (narrowest, widest)):
            a, b = share * one[1], share_of_other * other[1]
            apart = math.sqrt(max(0.0, a * a + b * b - 2.0 * a * b * math.cos(angle)))
            spacing = max(spacing, apart + largest * (one[2] + other[2]))
    return spacing


def _circle(leaf: Leaf) -> tuple[float, float]:
    """Centre on the axis, as its distance from the petiole base, and radius of a circle around a flat leaf [m]."""
    angle = axis_angle(leaf)
    axis = np.array([math.cos(angle), math.sin(angle)])
    along = leaf.mesh.positions @ axis
    centre = 0.5 * float(along.min() + along.max())
    return centre, float(np.linalg.norm(leaf.mesh.positions - centre * axis, axis=1).max())


def _specimen(table: LeavesTable, index: int, axis: float, spacing: float, camber: LeafTable) -> Specimen:
    random = np.random.default_rng([table.seed, index])
    # All are drawn, whatever the scene asks for: no amount changes what the others are.
    size, stiffness, turn, tilt, roll = random.uniform(-1.0, 1.0, 5)
    water, seed = random.uniform(), int(random.integers(2**31))
    heading = math.radians(table.turn * turn)
    place = (0.0, 0.0, index * spacing)
    if table.arrangement == "stem":
        heading += index * GOLDEN_ANGLE - axis
    else:
        column, row = grid_cell(index)
        place = (column * spacing, row * spacing, 0.0)
    angles = (heading, math.radians(table.tilt * tilt), math.radians(table.roll * roll))
    return Specimen(
        size=1.0 + table.size * size,
        stiffness=1.0 + table.stiffness * stiffness,
        water=1.0 - table.water * water,
        seed=seed if table.camber else camber.seed,
        camber=camber.camber,
        rotation=_rotation(*angles, axis) if any(angles) else None,
        place=place,
    )


def grid_cell(index: int) -> tuple[int, int]:
    """Column and row in a square that grows around its first corner, so that further leaves move no other."""
    shell = math.isqrt(index)
    rest = index - shell * shell
    return (shell, rest) if rest <= shell else (2 * shell - rest, shell)


def _rotation(heading: float, tilt: float, roll: float, axis: float) -> np.ndarray:
    """Rolled about the leaf's axis, then its tip raised by the tilt, then turned about the vertical; shape [3, 3].

    Args:
        heading: About the vertical [rad].
        tilt: Of the axis, tip up [rad].
        roll: About the axis [rad].
        axis: Angle of the axis in the photo's plane, from the x axis [rad].
    """
    to_axis = _about(2, axis)
    return _about(2, heading) @ to_axis @ _about(1, -tilt) @ _about(0, roll) @ to_axis.T


def _about(axis: int, angle: float) -> np.ndarray:
    """Rotation about a coordinate axis, shape [3, 3]."""
    rotation = np.eye(3)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    rotation[[first, second], [first, second]] = math.cos(angle)
    rotation[second, first] = math.sin(angle)
    rotation[first, second] = -math.sin(angle)
    return rotation
