"""Sheets of two layers of which one shrinks more."""

from __future__ import annotations

import numpy as np

from leafwarp.sim.launch import State
from leafwarp.sim.plan import make_stages
from leafwarp.sim.stage import Interval, bind_stage
from leafwarp.study.verify.beams import BENDING, LEAF_SLENDERNESS, LENGTH, SLENDERNESS, bent
from leafwarp.study.verify.case import Check, near_share
from leafwarp.study.verify.drawn_leaf import leaf_of, scene_of
from leafwarp.study.verify.plate import BENDING_POISSON
from leafwarp.study.verify.sheets import KINDS, Sheet, clamped_sheet


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

    Narrow is what curves so little that it may curve crosswise, too; wide is what may not: at its free margins it
    does, to within ``sqrt(R h)`` of them, two cells here, which a mesh must resolve. A clamped or a free straight end
    is felt as far as ``sqrt(W) (R h)^(1/4)``, a quarter of the length for a square: the square plate without a mesh
    (:mod:`leafwarp.study.verify.plate`) rolls to 0.651 of ``1.5 de/h`` and not to 0.667, where one half as wide rolls
    to 0.668.
    """
    checks = []
    for kind in KINDS:
        for what, width, cells, curvature, slenderness, share in (
            ("narrow strip", LENGTH / 8, 80, 0.1 / LENGTH, SLENDERNESS, 1.0),
            ("wide plate", LENGTH / 2, 40, 0.6 / LENGTH, LEAF_SLENDERNESS, 1.0 + BENDING_POISSON),
            ("square plate", LENGTH, 40, 0.6 / LENGTH, LEAF_SLENDERNESS, 1.0 + BENDING_POISSON),
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
