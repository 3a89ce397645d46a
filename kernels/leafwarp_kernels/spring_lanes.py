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

from leafwarp_kernels.dihedral import lane_angle_between, lane_continued, lane_reachable
from leafwarp_kernels.lanes import LANES, Lanes, lane_cross, lane_dot, lane_sqrt

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
    x = spring_force_out.dtype()
    y = spring_force_out.dtype()
    z = spring_force_out.dtype()
    speed_x = spring_force_out.dtype()
    speed_y = spring_force_out.dtype()
    speed_z = spring_force_out.dtype()
    rest_length = spring_force_out.dtype()
    stiffness = spring_force_out.dtype()
    for lane in range(LANES):
        a = corners[block, 0, lane]
        b = corners[block, 1, lane]
        way = position[b] - position[a]
        x[lane] = way[0]
        y[lane] = way[1]
        z[lane] = way[2]
        speed = velocity[b] - velocity[a]
        speed_x[lane] = speed[0]
        speed_y[lane] = speed[1]
        speed_z[lane] = speed[2]
        edge = edges[block, lane]
        if edge >= 0:
            rest_length[lane] = edge_rest_length[edge]
            stiffness[lane] = edge_stiffness[edge]
    length = lane_sqrt(lane_dot(x, y, z, x, y, z))
    approach = lane_dot(speed_x, speed_y, speed_z, x, y, z)
    pull = edge_pull(length, approach, rest_length, stiffness, damping_time[0])
    x = wp.cw_mul(pull, x)
    y = wp.cw_mul(pull, y)
    z = wp.cw_mul(pull, z)
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
    edge_x = spring_force_out.dtype()
    edge_y = spring_force_out.dtype()
    edge_z = spring_force_out.dtype()
    side_cx = spring_force_out.dtype()
    side_cy = spring_force_out.dtype()
    side_cz = spring_force_out.dtype()
    side_dx = spring_force_out.dtype()
    side_dy = spring_force_out.dtype()
    side_dz = spring_force_out.dtype()
    slope_x = spring_force_out.dtype()
    slope_y = spring_force_out.dtype()
    slope_z = spring_force_out.dtype()
    speed_cx = spring_force_out.dtype()
    speed_cy = spring_force_out.dtype()
    speed_cz = spring_force_out.dtype()
    speed_dx = spring_force_out.dtype()
    speed_dy = spring_force_out.dtype()
    speed_dz = spring_force_out.dtype()
    rest_length = spring_force_out.dtype()
    edge_strength = spring_force_out.dtype()
    for lane in range(LANES):
        a = corners[block, 0, lane]
        b = corners[block, 1, lane]
        c = corners[block, 2, lane]
        d = corners[block, 3, lane]
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
        edge = edges[block, lane]
        if edge >= 0:
            rest_length[lane] = edge_rest_length[edge]
            edge_strength[lane] = edge_stiffness[edge]

    # As in dihedral(), lane by lane.
    delay = damping_time[0]
    one = spring_force_out.dtype(type(delay)(1.0))
    tiny = spring_force_out.dtype(type(delay)(1.0e-30))
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
    floor = wp.cw_mul(square, square) * type(delay)(1.0e-4) + tiny
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
    turn = angle - lane_reachable(hinge_rest_angle[block]) + rate * delay
    moment = -wp.cw_mul(hinge_stiffness[block], turn)
    scale_c = wp.cw_mul(moment, scale_c)
    scale_d = wp.cw_mul(moment, scale_d)
    cx = wp.cw_mul(scale_c, cx)
    cy = wp.cw_mul(scale_c, cy)
    cz = wp.cw_mul(scale_c, cz)
    dx = wp.cw_mul(scale_d, dx)
    dy = wp.cw_mul(scale_d, dy)
    dz = wp.cw_mul(scale_d, dz)
    approach = lane_dot(slope_x, slope_y, slope_z, edge_x, edge_y, edge_z)
    pull = edge_pull(length, approach, rest_length, edge_strength, delay)
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
