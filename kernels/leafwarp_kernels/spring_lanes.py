"""Edge and angular springs 32 at a time, for a CPU: :mod:`leafwarp_kernels.edge_springs` (paper, Eq. 3) and
:mod:`leafwarp_kernels.angular_springs` (Alg. 1 and 2) in vector lanes.

A hinge lies on an edge, so that a thread computes both springs of each edge of its block from the same four
vertices. The edges without a hinge, those of the margin, form blocks of their own. What a block finds is kept as x, y
and z of the forces on the vertices a and b of each edge and, of a hinge, on c and d; each vertex then sums its own in a
fixed order.

A lane without an edge has stiffness 0 and the vertex 0 four times: its forces are 0.
"""

from typing import Any

import warp as wp

from leafwarp_kernels.dihedral import lane_continued, lane_dihedral, lane_reachable
from leafwarp_kernels.lanes import (
    LANES,
    Lanes,
    lane_dot,
    lane_gather,
    lane_scaled,
    lane_sqrt,
)

wp.set_module_options({"enable_backward": False})


@wp.func
def edge_pull(length: Any, approach: Any, rest_length: Any, stiffness: Any, delay: Any):
    """Force with which an edge spring pulls its ends together, over its length, in each lane.

    Args:
        length: [m].
        approach: Scalar product of the ends' relative position and velocity [m^2/s].
        rest_length: [m].
        stiffness: [N/m].
        delay: Damping time [s], a scalar.
    """
    one = type(length)(type(delay)(1.0))
    inverse = wp.cw_div(one, wp.max(length, type(length)(type(delay)(1.0e-12))))
    strain_rate = wp.cw_mul(wp.cw_mul(approach, inverse), inverse)
    strain = one - wp.cw_mul(rest_length, inverse)
    return wp.cw_mul(stiffness, strain + strain_rate * delay)


@wp.func
def edge_ways(values: Any, corners: wp.array3d[wp.int32], block: wp.int32, like: Any):
    """From a to b of each edge of a block, x, y and z; of positions, or velocities. ``like`` is a lane vector."""
    x = type(like)()
    y = type(like)()
    z = type(like)()
    for lane in range(LANES):
        way = values[corners[block, 1, lane]] - values[corners[block, 0, lane]]
        x[lane] = way[0]
        y[lane] = way[1]
        z[lane] = way[2]
    return x, y, z


@wp.func
def hinge_ways(values: Any, corners: wp.array3d[wp.int32], block: wp.int32, like: Any):
    """From a to b, to c and to d of each hinge of a block, as :func:`edge_ways`."""
    bx = type(like)()
    by = type(like)()
    bz = type(like)()
    cx = type(like)()
    cy = type(like)()
    cz = type(like)()
    dx = type(like)()
    dy = type(like)()
    dz = type(like)()
    for lane in range(LANES):
        origin = values[corners[block, 0, lane]]
        way = values[corners[block, 1, lane]] - origin
        bx[lane] = way[0]
        by[lane] = way[1]
        bz[lane] = way[2]
        way = values[corners[block, 2, lane]] - origin
        cx[lane] = way[0]
        cy[lane] = way[1]
        cz[lane] = way[2]
        way = values[corners[block, 3, lane]] - origin
        dx[lane] = way[0]
        dy[lane] = way[1]
        dz[lane] = way[2]
    return bx, by, bz, cx, cy, cz, dx, dy, dz


@wp.kernel
def edge_forces(
    # inputs:
    position: wp.array[Any],
    velocity: wp.array[Any],
    corners: wp.array3d[wp.int32],
    edges: wp.array2d[wp.int32],
    edge_rest_length: wp.array[wp.Float],
    edge_stiffness: wp.array[wp.Float],
    damping_time: wp.array[wp.Float],
    # outputs:
    spring_force_out: wp.array2d[Lanes],
):
    """Forces of blocks of edges that have no hinge.

    Args:
        position: [m], shape [vertex_count].
        velocity: [m/s], shape [vertex_count].
        corners: The vertices a and b of each edge, shape [block, 2, lane].
        edges: Index of each edge, shape [block, lane]; -1 in lanes without one.
        edge_rest_length: [m], shape [edge_count].
        edge_stiffness: [N/m], shape [edge_count].
        damping_time: [s], shape [1].
        spring_force_out: x, y and z of the forces on a and b [N], shape [block, 6].
    """
    block = wp.tid()
    like = spring_force_out.dtype()
    x, y, z = edge_ways(position, corners, block, like)
    speed_x, speed_y, speed_z = edge_ways(velocity, corners, block, like)
    rest_length = lane_gather(edge_rest_length, edges, block, like)
    stiffness = lane_gather(edge_stiffness, edges, block, like)
    length = lane_sqrt(lane_dot(x, y, z, x, y, z))
    approach = lane_dot(speed_x, speed_y, speed_z, x, y, z)
    pull = edge_pull(length, approach, rest_length, stiffness, damping_time[0])
    x, y, z = lane_scaled(pull, x, y, z)
    spring_force_out[block, 0] = x
    spring_force_out[block, 1] = y
    spring_force_out[block, 2] = z
    spring_force_out[block, 3] = -x
    spring_force_out[block, 4] = -y
    spring_force_out[block, 5] = -z


@wp.kernel
def edge_and_hinge_forces(
    # inputs:
    position: wp.array[Any],
    velocity: wp.array[Any],
    corners: wp.array3d[wp.int32],
    edges: wp.array2d[wp.int32],
    edge_rest_length: wp.array[wp.Float],
    edge_stiffness: wp.array[wp.Float],
    hinge_rest_angle: wp.array[Lanes],
    hinge_stiffness: wp.array[Lanes],
    damping_time: wp.array[wp.Float],
    # in and out:
    hinge_angle: wp.array[Lanes],
    # outputs:
    spring_force_out: wp.array2d[Lanes],
):
    """Forces of blocks of hinges and of the edges that they lie on.

    Args:
        position: [m], shape [vertex_count].
        velocity: [m/s], shape [vertex_count].
        corners: The vertices a, b, c and d of each hinge, shape [block, 4, lane].
        edges: Index of the edge of each hinge, shape [block, lane]; -1 in lanes without one.
        edge_rest_length: [m], shape [edge_count].
        edge_stiffness: [N/m], shape [edge_count].
        hinge_rest_angle: [rad], shape [block].
        hinge_stiffness: [N m/rad], shape [block]; 0 in lanes without a hinge.
        damping_time: [s], shape [1].
        hinge_angle: Angle, continued from the one before [rad], shape [block].
        spring_force_out: x, y and z of the forces on a, b, c and d [N], shape [block, 12].
    """
    block = wp.tid()
    like = spring_force_out.dtype()
    delay = damping_time[0]
    edge_x, edge_y, edge_z, cx, cy, cz, dx, dy, dz = hinge_ways(position, corners, block, like)
    slope_x, slope_y, slope_z, lift_cx, lift_cy, lift_cz, lift_dx, lift_dy, lift_dz = hinge_ways(
        velocity, corners, block, like
    )
    length = lane_sqrt(lane_dot(edge_x, edge_y, edge_z, edge_x, edge_y, edge_z))
    approach = lane_dot(slope_x, slope_y, slope_z, edge_x, edge_y, edge_z)
    rest_length = lane_gather(edge_rest_length, edges, block, like)
    stiffness = lane_gather(edge_stiffness, edges, block, like)
    pull = edge_pull(length, approach, rest_length, stiffness, delay)

    angle, cx, cy, cz, dx, dy, dz, foot_c, foot_d = lane_dihedral(
        edge_x, edge_y, edge_z, cx, cy, cz, dx, dy, dz, length
    )
    angle = lane_continued(angle, hinge_angle[block])
    hinge_angle[block] = angle
    rate = lane_dot(cx, cy, cz, lift_cx, lift_cy, lift_cz) + lane_dot(dx, dy, dz, lift_dx, lift_dy, lift_dz)
    rate -= wp.cw_mul(foot_c, lane_dot(cx, cy, cz, slope_x, slope_y, slope_z))
    rate -= wp.cw_mul(foot_d, lane_dot(dx, dy, dz, slope_x, slope_y, slope_z))
    turn = angle - lane_reachable(hinge_rest_angle[block]) + rate * delay
    moment = -wp.cw_mul(hinge_stiffness[block], turn)
    cx, cy, cz = lane_scaled(moment, cx, cy, cz)
    dx, dy, dz = lane_scaled(moment, dx, dy, dz)
    bx = -(wp.cw_mul(foot_c, cx) + wp.cw_mul(foot_d, dx) + wp.cw_mul(pull, edge_x))
    by = -(wp.cw_mul(foot_c, cy) + wp.cw_mul(foot_d, dy) + wp.cw_mul(pull, edge_y))
    bz = -(wp.cw_mul(foot_c, cz) + wp.cw_mul(foot_d, dz) + wp.cw_mul(pull, edge_z))
    spring_force_out[block, 0] = -(bx + cx + dx)
    spring_force_out[block, 1] = -(by + cy + dy)
    spring_force_out[block, 2] = -(bz + cz + dz)
    spring_force_out[block, 3] = bx
    spring_force_out[block, 4] = by
    spring_force_out[block, 5] = bz
    spring_force_out[block, 6] = cx
    spring_force_out[block, 7] = cy
    spring_force_out[block, 8] = cz
    spring_force_out[block, 9] = dx
    spring_force_out[block, 10] = dy
    spring_force_out[block, 11] = dz


@wp.kernel
def sum_spring_forces(
    # inputs:
    vertex_place_start: wp.array[wp.int32],
    vertex_places: wp.array[wp.int32],
    spring_force: wp.array[wp.Float],
    # outputs:
    force_out: wp.array[Any],
):
    """Sum the springs' forces on each vertex, in a fixed order; overwrites the force.

    Args:
        vertex_place_start: Where each vertex's places start, shape [vertex_count + 1].
        vertex_places: Places of the x of the forces on each vertex.
        spring_force: Forces by block, component and lane [N], flattened.
        force_out: Force on each vertex [N], shape [vertex_count].
    """
    vertex = wp.tid()
    force = force_out.dtype()
    for k in range(vertex_place_start[vertex], vertex_place_start[vertex + 1]):
        place = vertex_places[k]
        force[0] += spring_force[place]
        force[1] += spring_force[place + LANES]
        force[2] += spring_force[place + 2 * LANES]
    force_out[vertex] = force
