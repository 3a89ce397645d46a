"""Edge springs (paper, Eq. 3), damped along their direction.

On vertex ``i``, from each edge to a ``j``, with ``d = x_i - x_j``, length ``L = |d|`` and rest length ``l``:

    F_i = -(k (L - l) + tau k dL/dt) d / L,      dL/dt = (v_i - v_j).d / L.

``tau`` [s] is the damping time (stiffness-proportional damping). The force lies along the spring and acts on
both ends with opposite signs, so that it conserves linear and angular momentum. Every vertex sums its own
edges in a fixed order: no atomics, and the same bits in every run. On a GPU a thread is a vertex and computes the
force of each of its edges; on a CPU a thread computes the forces of a block of edges in its vector lanes, and the
vertices sum them.
"""

from typing import Any

import warp as wp

from leafwarp_kernels.lanes import LANES, Lanes, lane_dot, lane_sqrt

wp.set_module_options({"enable_backward": False})


@wp.kernel
def edge_spring_forces(
    # inputs:
    position: wp.array[Any],
    velocity: wp.array[Any],
    vertex_edge_start: wp.array[wp.int32],
    vertex_edges: wp.array[wp.int32],
    vertex_neighbors: wp.array[wp.int32],
    edge_rest_length: wp.array[wp.Float],
    edge_stiffness: wp.array[wp.Float],
    damping_time: wp.array[wp.Float],
    # outputs:
    force_out: wp.array[Any],
):
    """Sum of the edge springs' forces on each vertex; overwrites the force. An edge of no length has no
    direction and so no force."""
    vertex = wp.tid()
    here = position[vertex]
    speed = velocity[vertex]
    delay = damping_time[0]
    force = force_out.dtype()
    for k in range(vertex_edge_start[vertex], vertex_edge_start[vertex + 1]):
        edge = vertex_edges[k]
        other = vertex_neighbors[k]
        along = here - position[other]
        inverse = type(delay)(1.0) / wp.max(wp.length(along), type(delay)(1.0e-12))
        strain_rate = wp.dot(speed - velocity[other], along) * inverse * inverse
        strain = type(delay)(1.0) - edge_rest_length[edge] * inverse
        force -= along * (edge_stiffness[edge] * (strain + delay * strain_rate))
    force_out[vertex] = force


@wp.kernel
def edge_spring_forces_lanes(
    # inputs:
    position: wp.array[Any],
    velocity: wp.array[Any],
    edge_ends: wp.array3d[wp.int32],
    edge_rest_length: wp.array[Lanes],
    edge_stiffness: wp.array[Lanes],
    damping_time: wp.array[wp.Float],
    # outputs:
    edge_force_out: wp.array2d[Lanes],
):
    """Force of each edge of a block on its first vertex.

    Args:
        position: [m], shape [vertex_count].
        velocity: [m/s], shape [vertex_count].
        edge_ends: The two vertices of each edge, shape [block, 2, lane].
        edge_rest_length: [m], shape [block].
        edge_stiffness: [N/m], shape [block]; 0 in lanes without an edge.
        damping_time: [s], shape [1].
        edge_force_out: Its x, y and z [N], shape [block, 3].
    """
    block = wp.tid()
    stiffness = edge_stiffness[block]
    one = type(stiffness)(damping_time.dtype(1.0))
    shortest = type(stiffness)(damping_time.dtype(1.0e-12))
    x = type(stiffness)()
    y = type(stiffness)()
    z = type(stiffness)()
    speed_x = type(stiffness)()
    speed_y = type(stiffness)()
    speed_z = type(stiffness)()
    for lane in range(LANES):
        first = edge_ends[block, 0, lane]
        second = edge_ends[block, 1, lane]
        along = position[first] - position[second]
        speed = velocity[first] - velocity[second]
        x[lane] = along[0]
        y[lane] = along[1]
        z[lane] = along[2]
        speed_x[lane] = speed[0]
        speed_y[lane] = speed[1]
        speed_z[lane] = speed[2]
    inverse = wp.cw_div(one, wp.max(lane_sqrt(lane_dot(x, y, z, x, y, z)), shortest))
    strain_rate = wp.cw_mul(wp.cw_mul(lane_dot(speed_x, speed_y, speed_z, x, y, z), inverse), inverse)
    strain = one - wp.cw_mul(edge_rest_length[block], inverse)
    pull = -wp.cw_mul(stiffness, strain + strain_rate * damping_time[0])
    edge_force_out[block, 0] = wp.cw_mul(pull, x)
    edge_force_out[block, 1] = wp.cw_mul(pull, y)
    edge_force_out[block, 2] = wp.cw_mul(pull, z)


@wp.kernel
def gather_edge_forces(
    # inputs:
    vertex_edge_start: wp.array[wp.int32],
    vertex_edge_places: wp.array[wp.int32],
    edge_force: wp.array[wp.Float],
    # outputs:
    force_out: wp.array[Any],
):
    """Sum the forces of each vertex's edges, in a fixed order; overwrites the force.

    Args:
        vertex_edge_start: Where each vertex's edges start, shape [vertex_count + 1].
        vertex_edge_places: Place of the x of each edge's force; one's complement of it at the second vertex.
        edge_force: From :func:`edge_spring_forces_lanes`, flattened.
        force_out: Force on each vertex [N], shape [vertex_count].
    """
    vertex = wp.tid()
    force = force_out.dtype()
    for k in range(vertex_edge_start[vertex], vertex_edge_start[vertex + 1]):
        place = vertex_edge_places[k]
        if place >= 0:
            force[0] += edge_force[place]
            force[1] += edge_force[place + LANES]
            force[2] += edge_force[place + 2 * LANES]
        else:
            place = -1 - place
            force[0] -= edge_force[place]
            force[1] -= edge_force[place + LANES]
            force[2] -= edge_force[place + 2 * LANES]
    force_out[vertex] = force
