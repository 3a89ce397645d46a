"""Sheets that bend under loads: cantilevers and columns.

The hinges stand for a sheet whose bending Poisson ratio is -1/3. A narrow strip of it bends with ``8/9 D``, a wide
plate with ``D``, and one half as wide as it is long, as here, with 0.953 D in linear theory: its clamped edge keeps it
from curving crosswise. As it bends further it can no longer curve crosswise, too, without stretching, and it becomes a
wide plate: once its width squared times its curvature is far above its thickness. The cantilevers here are 70 times as
long as thick, and the elastica with 0.95 D is up to 1.5 % off them, whatever the mesh. So two things are compared: the
droop with that elastica, and how the error falls with the plate itself (:mod:`leafwarp.study.verify.plate`). A sheet
as thin as a leaf is compared with the elastica of a wide plate.

A droop is off the plate's by what the margins and the free end miss, half a cell of hinges, which is of first order in
the edge length, and on irregular meshes by a scatter: patches whose triangles are all longer one way are stiffer that
way by as much, and patches do not shrink as fast as triangles. One irregular mesh may be right by luck; so several are
made, and the root mean square of their errors is what falls.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from leafwarp.errors import LeafwarpError
from leafwarp.sim import material
from leafwarp.sim.implicit import NotConverged
from leafwarp.sim.implicit.equilibrium import equilibrium
from leafwarp.study.verify.case import Check, at_most, near, near_share
from leafwarp.study.verify.elastica import elastica, greenhill_number
from leafwarp.study.verify.plate import BENDING_POISSON, plate_drops
from leafwarp.study.verify.sheets import KINDS, Kind, Sheet, clamped_sheet

LENGTH, WIDTH = 0.1, 0.05  # [m]
BENDING = 1e-6  # D [N m]
SHARE = 0.95  # effective bending stiffness of a sheet half as wide as long, over D, in linear theory
SLENDERNESS, LEAF_SLENDERNESS = 70.0, 1000.0  # length over thickness
WEIGHTS = (0.5, 2.0, 10.0, 30.0, 80.0, 200.0)  # sigma g L^3 / D
CELLS = (10, 20, 40)  # edges in a length
SEEDS = {"hexagonal": (0,), "irregular": tuple(range(8))}  # of the meshes of a kind
TOLERANCE = 0.03
GRAVITY = 9.81  # [m/s^2]
# Why a row may fail, and up to which error that explains it.
NOT_THE_LIMIT = (
    "0.95 D is the limit of the springs only about: the plate that they stand for is up to 1.5 % off that elastica, so "
    "that the error against it may rise as a mesh is refined; the rows against the plate judge what falls"
)
SCATTER = (
    "irregular meshes scatter by 1 % about their mean, which another row judges; one of them may be further off than "
    "the tolerance"
)
EXPLAINED = 1.5 * TOLERANCE


def membrane_stiffness(thickness: float) -> float:
    """``E h`` [N/m] of a sheet of the bending stiffness ``D = E h^3 / (12 (1 - nu^2))``."""
    return 12.0 * (1.0 - BENDING_POISSON**2) * BENDING / thickness**2


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
def droop(kind: Kind, cells: int, device: str, seed: int = 0, slenderness: float = SLENDERNESS) -> dict[float, float]:
    """Drop of the end under each weight, over the length; each starts from the shape under the weight before."""
    sheet = clamped_sheet(kind, LENGTH, WIDTH, cells, seed)
    shape, drops = sheet.positions, {}
    for weight in WEIGHTS if slenderness == SLENDERNESS else WEIGHTS[1:2]:
        masses = weight_masses(sheet, weight)
        shape = bent(sheet, shape, LENGTH / slenderness, device, masses=masses, gravity=(0.0, 0.0, -GRAVITY))
        drops[weight] = float(-shape[sheet.end, 2].mean() / LENGTH)
    return drops


def droops(kind: Kind, cells: int, device: str) -> np.ndarray:
    """The drops of all meshes of a kind, shape [mesh_count, weight_count]."""
    return np.array([list(droop(kind, cells, device, seed).values()) for seed in SEEDS[kind]])


def expected_droop(weight: float, share: float = SHARE) -> float:
    """Drop of the end of the elastica under its own weight, over its length."""
    return float(elastica(weight=round(weight / share, 9)).drop[-1])


def plate_errors(kind: Kind, cells: int, device: str) -> np.ndarray:
    """The drops of all meshes of a kind over the plate's of their width, less 1, shape [mesh_count, weight_count]."""
    width = clamped_sheet("hexagonal", LENGTH, WIDTH, cells).width
    plate = plate_drops(round(width / LENGTH, 9), SLENDERNESS, WEIGHTS)
    return droops(kind, cells, device) / np.array(list(plate.values())) - 1.0


def own_weight(device: str) -> list[Check]:
    """Six weights on two kinds of meshes; a sheet as thin as a leaf is a wide plate."""
    checks = []
    coarse, fine = CELLS[0], CELLS[-1]
    for kind in KINDS:
        count = len(SEEDS[kind])
        meshes = kind if count == 1 else f"{kind}, mean of {count}"
        spread = kind if count == 1 else f"{kind}, rms of {count}"
        for weight, got in zip(WEIGHTS, droops(kind, fine, device).mean(axis=0), strict=True):
            name = f"{meshes}, h = L/{fine}, weight {weight:g}: droop / length"
            checks.append(near_share(name, expected_droop(weight), got, TOLERANCE))
        errors = {cells: plate_errors(kind, cells, device) for cells in (coarse, fine)}
        sizes = {cells: np.sqrt(np.mean(each**2, axis=0)) for cells, each in errors.items()}
        for weight, ratio in zip(WEIGHTS, sizes[fine] / sizes[coarse], strict=True):
            name = f"{spread}, weight {weight:g}: error against a plate at L/{fine} over that at L/{coarse}"
            checks.append(at_most(name, 1.0, ratio))
        checks += _against_the_limit(kind, device)
        name = f"{kind}, h = L/{fine}: error against a plate, the worst of all meshes and weights"
        checks.append(near(name, 0.0, np.abs(errors[fine]).max(), TOLERANCE))
        for weight, drop in droop(kind, fine, device, slenderness=LEAF_SLENDERNESS).items():
            name = f"{kind}, thin as a leaf, weight {weight:g}: droop / length"
            checks.append(near_share(name, expected_droop(weight, share=1.0), drop, TOLERANCE))
    return checks


def _against_the_limit(kind: Kind, device: str) -> list[Check]:
    """Each mesh against the elastica with 0.95 D, and whether it comes nearer to it as the mesh is refined."""
    coarse, fine = CELLS[0], CELLS[-1]
    expected = np.array([expected_droop(weight) for weight in WEIGHTS])
    errors = {cells: np.abs(droops(kind, cells, device) / expected - 1.0) for cells in (coarse, fine)}
    checks = []
    for mesh, (before, after) in enumerate(zip(errors[coarse], errors[fine], strict=True)):
        name = f"{kind} {mesh}" if len(SEEDS[kind]) > 1 else kind
        worst = near(f"{name}, h = L/{fine}: worst error against 0.95 D", 0.0, after.max(), TOLERANCE)
        checks.append(replace(worst, explanation=SCATTER) if worst.error <= EXPLAINED else worst)
        rises = at_most(
            f"{name}: weights of {len(WEIGHTS)} whose error against 0.95 D rises", 0, (after > before).sum()
        )
        checks.append(replace(rises, explanation=NOT_THE_LIMIT))
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
        push[sheet.end, 2] = 1e-3 * BENDING * sheet.width / LENGTH**2 / len(sheet.end)
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
