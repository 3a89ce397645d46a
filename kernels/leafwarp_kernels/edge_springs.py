"""Edge springs (paper, Eq. 3), damped along their direction.

On vertex ``i``, from each edge to a ``j``, with ``d = x_i - x_j``, length ``L = |d|`` and rest length ``l``:

    F_i = -(k (L - l) + tau k dL/dt) d / L,      dL/dt = (v_i - v_j).d / L.

``tau`` [s] is the damping time (stiffness-proportional damping). The force lies along the spring and acts on
both ends with opposite signs, so that it conserves linear and angular momentum. Every vertex sums its own
edges in a fixed order: no atomics, and the same bits in every run.
"""

from typing import Any

import warp as wp

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
