"""Sheets that bend: cantilevers, columns, and two layers of which one shrinks more.

The hinges stand for a sheet whose bending Poisson ratio is -1/3. A narrow strip of it bends with ``8/9 D``, a wide
plate with ``D``, and one half as wide as it is long, as here, with 0.95 D in linear theory. As it bends further the
sheet can no longer curve crosswise, too, without stretching, and it becomes a wide plate: once its width squared times
its curvature is far above its thickness. The cantilevers here are 70 times as long as thick; one that is as thin as
a leaf is compared with a plate.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from leafwarp.errors import LeafwarpError
from leafwarp.sim import material
from leafwarp.sim.implicit import NotConverged
from leafwarp.sim.implicit.equilibrium import equilibrium
from leafwarp.sim.launch import State
from leafwarp.sim.plan import make_stages
from leafwarp.sim.stage import Interval, bind_stage
from leafwarp.study.verify.case import Check, at_most, near_share
from leafwarp.study.verify.drawn_leaf import leaf_of, scene_of
from leafwarp.study.verify.elastica import elastica, greenhill_number
from leafwarp.study.verify.sheets import KINDS, Kind, Sheet, clamped_sheet

LENGTH, WIDTH = 0.1, 0.05  # [m]
BENDING = 1e-6  # D [N m]
POISSON = -1.0 / 3.0
SHARE = 0.95  # effective bending stiffness of a sheet half as wide as long, over D, in linear theory
SLENDERNESS, LEAF_SLENDERNESS = 70.0, 1000.0  # length over thickness
WEIGHTS = (0.5, 2.0, 10.0, 30.0, 80.0, 200.0)  # sigma g L^3 / D
CELLS = (10, 20, 40)  # edges in a length
TOLERANCE = 0.03
GRAVITY = 9.81  # [m/s^2]


def membrane_stiffness(thickness: float) -> float:
    """``E h`` [N/m] of a sheet of the bending stiffness ``D = E h^3 / (12 (1 - nu^2))``."""
    return 12.0 * (1.0 - POISSON**2) * BENDING / thickness**2


def bent(
    sheet: Sheet, start: np.ndarray, thickness: float, device: str, rest_angles: np.ndarray | None = None, **loads
) -> np.ndarray:
    """Where a clamped sheet comes to rest [m], shape [vertex_count, 3]; loads are those of ``equilibrium``.

    Raises:
        LeafwarpError: It was not found.
    """
    mesh = sheet.mesh
    try:
        return equilibrium(
            start,
            mesh.edges,
            material.edge_lengths(mesh, sheet.positions),
            material.edge_stiffness(mesh, membrane_stiffness(thickness)),
            hinges=mesh.hinges,
            rest_angles=rest_angles,
            hinge_stiffness=material.hinge_stiffness(mesh, BENDING),
            pinned=sheet.held,
            device=device,
            **loads,
        ).positions
    except NotConverged as error:
        raise LeafwarpError(f"the sheet found no rest: {error}") from None


def weight_masses(sheet: Sheet, weight: float) -> np.ndarray:
    """Masses of a sheet of a weight number [kg]."""
    return weight * BENDING / sheet.length**3 / GRAVITY * sheet.mesh.vertex_areas


@cache
def droop(kind: Kind, cells: int, device: str, slenderness: float = SLENDERNESS) -> dict[float, float]:
    """Drop of the end under each weight, over the length; each starts from the shape under the weight before."""
    sheet = clamped_sheet(kind, LENGTH, WIDTH, cells)
    shape, drops = sheet.positions, {}
    for weight in WEIGHTS if slenderness == SLENDERNESS else WEIGHTS[1:2]:
        masses = weight_masses(sheet, weight)
        shape = bent(sheet, shape, LENGTH / slenderness, device, masses=masses, gravity=(0.0, 0.0, -GRAVITY))
        drops[weight] = float(-shape[sheet.end, 2].mean() / LENGTH)
    return drops


def expected_droop(weight: float, share: float = SHARE) -> float:
    """Drop of the end of the elastica under its own weight, over its length."""
    return float(elastica(weight=round(weight / share, 9)).drop[-1])


def own_weight(device: str) -> list[Check]:
    """Six weights on two meshes of three sizes; a sheet as thin as a leaf is a plate."""
    checks = []
    for kind in KINDS:
        for weight in WEIGHTS:
            got = droop(kind, CELLS[-1], device)[weight]
            name = f"{kind}, h = L/{CELLS[-1]}, weight {weight:g}: droop / length"
            checks.append(near_share(name, expected_droop(weight), got, TOLERANCE))
        coarse, fine = (
            np.mean([abs(drop / expected_droop(weight) - 1.0) for weight, drop in droop(kind, cells, device).items()])
            for cells in (CELLS[0], CELLS[-1])
        )
        name = f"{kind}: mean error at L/{CELLS[-1]} over that at L/{CELLS[0]}"
        checks.append(at_most(name, 1.0, fine / coarse))
        for weight, drop in droop(kind, CELLS[-1], device, LEAF_SLENDERNESS).items():
            name = f"{kind}, thin as a leaf, weight {weight:g}: droop / length"
            checks.append(near_share(name, expected_droop(weight, share=1.0), drop, TOLERANCE))
    return checks


def end_load(device: str) -> list[Check]:
    """``P L^2 / EI = 4`` on the free end: drop and reach of the elastica (Bisshopp and Drucker 1945)."""
    checks, number = [], 4.0
    expected = elastica(end_load=number)
    for kind in KINDS:
        sheet = clamped_sheet(kind, LENGTH, WIDTH, CELLS[-1])
        y = np.sort(sheet.mesh.positions[sheet.end, 1])
        # Each vertex bears the load of half the end on each side of it.
        shares = np.diff(np.concatenate([y[:1], 0.5 * (y[1:] + y[:-1]), y[-1:]])) / sheet.width
        loads = np.zeros((sheet.mesh.vertex_count, 3))
        order = sheet.end[np.argsort(sheet.mesh.positions[sheet.end, 1])]
        loads[order, 2] = -shares * number * SHARE * BENDING * sheet.width / LENGTH**2
        shape = sheet.positions
        for part in (0.25, 0.5, 1.0):
            shape = bent(sheet, shape, LENGTH / SLENDERNESS, device, loads=part * loads)
        ends = shape[sheet.end].mean(axis=0) / LENGTH
        name = f"{kind}, h = L/{CELLS[-1]}: "
        checks.append(near_share(f"{name}drop of the end / length", expected.drop[-1], -ends[2], TOLERANCE))
        checks.append(near_share(f"{name}reach of the end / length", expected.reach[-1], ends[0], TOLERANCE))
    return checks


def self_buckling(device: str) -> list[Check]:
    """The height at which an upright sheet buckles under its own weight, ``(7.8373 EI / (rho g A))^(1/3)``.

    A tiny push from the side bends the column by an amount that grows without limit as the critical weight is
    neared: its inverse is extrapolated to zero (Southwell 1932).
    """
    checks, density = [], 0.2 * GRAVITY  # weight of a unit of area [N/m^2]
    expected = (greenhill_number() * SHARE * BENDING / density) ** (1.0 / 3.0)
    for kind in KINDS:
        sheet = clamped_sheet(kind, LENGTH, WIDTH, CELLS[-1])
        push = np.zeros((sheet.mesh.vertex_count, 3))
        push[sheet.end, 2] = 1e-3 * BENDING * WIDTH / LENGTH**2 / len(sheet.end)
        weights = np.array([0.9, 0.95]) * SHARE * greenhill_number()
        softness = []
        for weight in weights:
            loads = {"masses": weight_masses(sheet, weight), "gravity": (-GRAVITY, 0.0, 0.0), "loads": push}
            # The push is small beside the forces within the sheet.
            shape = bent(sheet, sheet.positions, LENGTH / SLENDERNESS, device, tolerance=1e-9, **loads)
            softness.append(shape[sheet.end, 2].mean())
        inverse = 1.0 / np.array(softness)
        critical = weights[0] + inverse[0] * (weights[1] - weights[0]) / (inverse[0] - inverse[1])
        height = (critical * BENDING / density) ** (1.0 / 3.0)
        checks.append(near_share(f"{kind}, h = L/{CELLS[-1]}: height that buckles [m]", expected, height, 0.01))
    return checks


def timoshenko_curvature(mismatch: float, thickness: float, m: float, n: float) -> float:
    """Curvature of two layers [1/m] (Timoshenko 1925): ``6 de (1+m)^2 / (h [3 (1+m)^2 + (1+m n)(m^2 + 1/(m n))])``.

    Args:
        mismatch: Strain between them, ``de``.
        thickness: Of both together [m], ``h``.
        m: Thickness of one over that of the other.
        n: Young's modulus of the one over that of the other.
    """
    squared = (1.0 + m) ** 2
    return 6.0 * mismatch * squared / (thickness * (3.0 * squared + (1.0 + m * n) * (m**2 + 1.0 / (m * n))))


def _layered_curvature(mismatch: float, thickness: float, m: float, n: float) -> float:
    """The same by balancing the stresses of a beam of two layers: no force and no moment is left."""
    low, high = -0.5 * thickness, 0.5 * thickness
    border = low + thickness * m / (1.0 + m)
    system, right = np.zeros((2, 2)), np.zeros(2)
    for modulus, strain, a, b in ((n, mismatch, low, border), (1.0, 0.0, border, high)):
        moments = [modulus * (b**k - a**k) / k for k in (1, 2, 3)]
        system += [[moments[0], moments[1]], [moments[1], moments[2]]]
        right += strain * np.array(moments[:2])
    return float(abs(np.linalg.solve(system, right)[1]))


def dry_rest_angles(sheet: Sheet, mismatch: float, thickness: float, device: str) -> np.ndarray:
    """Rest angles of the dry sheet as the simulation's coupling sets them from a scene's [curl] [rad]."""
    scene = scene_of(
        {"bending_stiffness": BENDING},
        water={"curve": [[0.0, 1.0], [1.0, 0.0]]},
        curl={"mismatch": [[0.0, mismatch], [1.0, 0.0]], "thickness": thickness},
        solver={"precision": "float64"},
    )
    leaf = leaf_of(sheet.mesh)
    groups = [make_stages(scene, leaf, group)[0] for group in ("motion", "coupling")]
    stages = [stage for group in groups for stage in group]
    state = State([spec for stage in stages for spec in stage.arrays], device, "float64")
    for stage in stages:
        bind_stage(stage, state)
    for stage in groups[1]:
        if stage.rate == "frame":
            stage.run(Interval(0.0, 1.0))
    return state["hinge_rest_angle"].numpy().copy()


def curvature_along(sheet_xy: np.ndarray, shape: np.ndarray, inside: np.ndarray) -> tuple[float, float]:
    """Normal curvature of a surface [1/m] along x and along y of the flat sheet.

    Args:
        sheet_xy: Places on the flat sheet [m], shape [vertex_count, 2].
        shape: Where they are now [m], shape [vertex_count, 3].
        inside: Vertices to which a surface of second order is fitted, bool; the curvatures are those at their middle.
    """
    x, y = (sheet_xy[inside] - sheet_xy[inside].mean(axis=0)).T
    terms = np.column_stack((np.ones_like(x), x, y, 0.5 * x**2, x * y, 0.5 * y**2))
    _, along_x, along_y, bend_x, _, bend_y = np.linalg.lstsq(terms, shape[inside], rcond=None)[0]
    normal = np.cross(along_x, along_y)
    normal /= np.linalg.norm(normal)
    return float(bend_x @ normal / (along_x @ along_x)), float(bend_y @ normal / (along_y @ along_y))


def two_layers(device: str) -> list[Check]:
    """An isotropic mismatch bends a narrow strip to ``1.5 de/h`` and rolls a wide plate to 2/3 of it.

    Narrow is what curves so little that it may curve crosswise, too; wide is what may not.
    """
    checks = []
    for m, n in ((1.0, 1.0), (0.5, 3.0), (4.0, 0.1)):
        name = f"thicknesses 1:{m:g}, moduli 1:{n:g}: Timoshenko's curvature for de/h = 1/m"
        checks.append(
            near_share(name, _layered_curvature(1e-3, 1e-3, m, n), timoshenko_curvature(1e-3, 1e-3, m, n), 1e-12)
        )
    for kind in KINDS:
        for what, width, cells, curvature, slenderness, share in (
            ("narrow strip", LENGTH / 8, 80, 0.1 / LENGTH, SLENDERNESS, 1.0),
            ("wide plate", WIDTH, 40, 0.6 / LENGTH, LEAF_SLENDERNESS, 1.0 + POISSON),
        ):
            sheet = clamped_sheet(kind, LENGTH, width, cells)
            thickness = LENGTH / slenderness
            mismatch = curvature * thickness / 1.5
            expected = timoshenko_curvature(mismatch, thickness, 1.0, 1.0)
            shape = sheet.positions
            for part in (0.5, 1.0):
                angles = dry_rest_angles(sheet, part * mismatch, thickness, device)
                shape = bent(sheet, shape, thickness, device, rest_angles=angles)
            x, y = sheet.mesh.positions.T
            inside = (np.abs(x - 0.6 * LENGTH) < 0.2 * LENGTH) & (np.abs(y) < max(0.2 * width, 0.05 * LENGTH))
            got, _ = curvature_along(sheet.mesh.positions, shape, inside)
            checks.append(near_share(f"{kind}, {what}: curvature [1/m]", share * expected, got, 0.05))
    return checks
