"""Angular springs: the gradient of their energy (paper, Alg. 1 and 2, made continuous and conservative).

A hinge with the dihedral angle ``theta`` (see :mod:`leafwarp_kernels.dihedral`) holds
``k/2 (theta - theta0)^2`` and resists its rate of change with the damping time ``tau``:

    F_j = -(k (theta - theta0) + tau k dtheta/dt) grad_j theta,
    dtheta/dt = sum over the four vertices of grad_j theta . v_j.

The paper's Alg. 2 adds pi to the angle of a fold on the far side, which jumps at the flat state; its Eq. (4)
pushes only the two opposite vertices. The gradient also pulls the edge's own, and conserves linear and
angular momentum.
"""

from typing import Any

import warp as wp

from leafwarp_kernels.dihedral import (
    continued,
    dihedral,
    lane_angle_between,
    lane_continued,
    lane_reachable,
    reachable,
)
from leafwarp_kernels.lanes import LANES, Lanes, lane_cross, lane_dot, lane_sqrt

wp.set_module_options({"enable_backward": False})


@wp.kernel
def angular_spring_forces(
    # inputs:
    position: wp.array[Any],
    velocity: wp.array[Any],
    hinge_vertices: wp.array2d[wp.int32],
    hinge_rest_angle: wp.array[wp.Float],
    hinge_stiffness: wp.array[wp.Float],
    damping_time: wp.array[wp.Float],
    # in and out:
    hinge_angle: wp.array[wp.Float],
    # outputs:
    hinge_force_out: wp.array[Any],
):
    """Forces of each hinge on its four vertices, and its angle, continued from the one before."""
    hinge = wp.tid()
    a = hinge_vertices[hinge, 0]
    b = hinge_vertices[hinge, 1]
    c = hinge_vertices[hinge, 2]
    d = hinge_vertices[hinge, 3]
    angle, gradient_c, gradient_d, foot_c, foot_d = dihedral(position[a], position[b], position[c], position[d])
    angle = continued(angle, hinge_angle[hinge])
    hinge_angle[hinge] = angle
    base = velocity[a]
    slope = velocity[b] - base
    rate = wp.dot(gradient_c, velocity[c] - base - foot_c * slope)
    rate += wp.dot(gradient_d, velocity[d] - base - foot_d * slope)
    moment = -hinge_stiffness[hinge] * (angle - reachable(hinge_rest_angle[hinge]) + damping_time[0] * rate)
    force_c = moment * gradient_c
    force_d = moment * gradient_d
    force_b = -(foot_c * force_c + foot_d * force_d)
    hinge_force_out[4 * hinge] = -(force_b + force_c + force_d)
    hinge_force_out[4 * hinge + 1] = force_b
    hinge_force_out[4 * hinge + 2] = force_c
    hinge_force_out[4 * hinge + 3] = force_d


@wp.kernel
def angular_spring_forces_lanes(
    # inputs:
    position: wp.array[Any],
    velocity: wp.array[Any],
    hinge_corners: wp.array3d[wp.int32],
    hinge_rest_angle: wp.array[Lanes],
    hinge_stiffness: wp.array[Lanes],
    damping_time: wp.array[wp.Float],
    # in and out:
    hinge_angle: wp.array[Lanes],
    # outputs:
    hinge_force_out: wp.array2d[Lanes],
):
    """:func:`angular_spring_forces` for a CPU, a block of hinges at a time.

    Args:
        position: [m], shape [vertex_count].
        velocity: [m/s], shape [vertex_count].
        hinge_corners: The four vertices a, b, c, d of each hinge, shape [block, 4, lane].
        hinge_rest_angle: [rad], shape [block].
        hinge_stiffness: [N m/rad], shape [block]; 0 in lanes without a hinge.
        damping_time: [s], shape [1].
        hinge_angle: Angle, continued from the one before [rad], shape [block].
        hinge_force_out: x, y and z of the forces on a, b, c and d [N], shape [block, 12].
    """
    block = wp.tid()
    stiffness = hinge_stiffness[block]
    zero = type(stiffness)()
    edge_x = zero
    edge_y = zero
    edge_z = zero
    side_cx = zero
    side_cy = zero
    side_cz = zero
    side_dx = zero
    side_dy = zero
    side_dz = zero
    slope_x = zero
    slope_y = zero
    slope_z = zero
    speed_cx = zero
    speed_cy = zero
    speed_cz = zero
    speed_dx = zero
    speed_dy = zero
    speed_dz = zero
    for lane in range(LANES):
        a = hinge_corners[block, 0, lane]
        b = hinge_corners[block, 1, lane]
        c = hinge_corners[block, 2, lane]
        d = hinge_corners[block, 3, lane]
        origin = position[a]
        way = position[b] - origin
        edge_x[lane] = way[0]
        edge_y[lane] = way[1]
        edge_z[lane] = way[2]
        way = position[c] - origin
        side_cx[lane] = way[0]
        side_cy[lane] = way[1]
        side_cz[lane] = way[2]
        way = position[d] - origin
        side_dx[lane] = way[0]
        side_dy[lane] = way[1]
        side_dz[lane] = way[2]
        base = velocity[a]
        speed = velocity[b] - base
        slope_x[lane] = speed[0]
        slope_y[lane] = speed[1]
        slope_z[lane] = speed[2]
        speed = velocity[c] - base
        speed_cx[lane] = speed[0]
        speed_cy[lane] = speed[1]
        speed_cz[lane] = speed[2]
        speed = velocity[d] - base
        speed_dx[lane] = speed[0]
        speed_dy[lane] = speed[1]
        speed_dz[lane] = speed[2]

    # As in dihedral(), lane by lane.
    one = type(stiffness)(damping_time.dtype(1.0))
    tiny = type(stiffness)(damping_time.dtype(1.0e-30))
    cx, cy, cz = lane_cross(edge_x, edge_y, edge_z, side_cx, side_cy, side_cz)
    dx, dy, dz = lane_cross(side_dx, side_dy, side_dz, edge_x, edge_y, edge_z)
    square = lane_dot(edge_x, edge_y, edge_z, edge_x, edge_y, edge_z)
    square_c = lane_dot(cx, cy, cz, cx, cy, cz)
    square_d = lane_dot(dx, dy, dz, dx, dy, dz)
    length = lane_sqrt(square)
    sine = wp.cw_mul(length, lane_dot(side_cx, side_cy, side_cz, dx, dy, dz))
    angle = lane_angle_between(sine, lane_dot(cx, cy, cz, dx, dy, dz))
    angle = lane_continued(angle, hinge_angle[block])
    hinge_angle[block] = angle
    floor = wp.cw_mul(square, square) * damping_time.dtype(1.0e-4) + tiny
    inverse_c = wp.cw_div(one, wp.max(square_c, floor))
    inverse_d = wp.cw_div(one, wp.max(square_d, floor))
    scale_c = wp.cw_mul(wp.cw_mul(length, inverse_c), wp.cw_mul(square_d, inverse_d))
    scale_d = wp.cw_mul(wp.cw_mul(length, inverse_d), wp.cw_mul(square_c, inverse_c))
    inverse_square = wp.cw_div(one, wp.max(square, tiny))
    foot_c = wp.cw_mul(lane_dot(side_cx, side_cy, side_cz, edge_x, edge_y, edge_z), inverse_square)
    foot_d = wp.cw_mul(lane_dot(side_dx, side_dy, side_dz, edge_x, edge_y, edge_z), inverse_square)

    speed_cx = speed_cx - wp.cw_mul(foot_c, slope_x)
    speed_cy = speed_cy - wp.cw_mul(foot_c, slope_y)
    speed_cz = speed_cz - wp.cw_mul(foot_c, slope_z)
    speed_dx = speed_dx - wp.cw_mul(foot_d, slope_x)
    speed_dy = speed_dy - wp.cw_mul(foot_d, slope_y)
    speed_dz = speed_dz - wp.cw_mul(foot_d, slope_z)
    rate = wp.cw_mul(scale_c, lane_dot(cx, cy, cz, speed_cx, speed_cy, speed_cz))
    rate += wp.cw_mul(scale_d, lane_dot(dx, dy, dz, speed_dx, speed_dy, speed_dz))
    moment = -wp.cw_mul(stiffness, angle - lane_reachable(hinge_rest_angle[block]) + rate * damping_time[0])
    scale_c = wp.cw_mul(moment, scale_c)
    scale_d = wp.cw_mul(moment, scale_d)
    cx = wp.cw_mul(scale_c, cx)
    cy = wp.cw_mul(scale_c, cy)
    cz = wp.cw_mul(scale_c, cz)
    dx = wp.cw_mul(scale_d, dx)
    dy = wp.cw_mul(scale_d, dy)
    dz = wp.cw_mul(scale_d, dz)
    bx = -(wp.cw_mul(foot_c, cx) + wp.cw_mul(foot_d, dx))
    by = -(wp.cw_mul(foot_c, cy) + wp.cw_mul(foot_d, dy))
    bz = -(wp.cw_mul(foot_c, cz) + wp.cw_mul(foot_d, dz))
    hinge_force_out[block, 0] = -(bx + cx + dx)
    hinge_force_out[block, 1] = -(by + cy + dy)
    hinge_force_out[block, 2] = -(bz + cz + dz)
    hinge_force_out[block, 3] = bx
    hinge_force_out[block, 4] = by
    hinge_force_out[block, 5] = bz
    hinge_force_out[block, 6] = cx
    hinge_force_out[block, 7] = cy
    hinge_force_out[block, 8] = cz
    hinge_force_out[block, 9] = dx
    hinge_force_out[block, 10] = dy
    hinge_force_out[block, 11] = dz
