"""The potential that a step of implicit motion minimises, and its gradient.

    Phi(x) = sum over edges  k/2 (L - l)^2  +  sum over hinges  k/2 (theta - theta0)^2
             + sum over vertices  w/2 |x - x*|^2 - f.x.

The inertia ``w = m / dt^2`` draws each vertex to where it would go on its own, ``x*``; ``f`` is a dead load such as
the weight. The hinges' part is in :mod:`leafwarp_kernels.hinge_potential`. Every vertex sums its edges in a fixed
order: no atomics, and the same bits in every run.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def membrane_gradient(
    # inputs:
    position: wp.array[wp.vec3d],
    vertex_edge_start: wp.array[wp.int32],
    vertex_edges: wp.array[wp.int32],
    vertex_neighbors: wp.array[wp.int32],
    edge_target_length: wp.array[wp.float64],
    edge_strength: wp.array[wp.float64],
    inertia: wp.array[wp.float64],
    goal: wp.array[wp.vec3d],
    load: wp.array[wp.vec3d],
    pinned: wp.array[wp.bool],
    # outputs:
    gradient_out: wp.array[wp.vec3d],
    energy_out: wp.array[wp.float64],
    magnitude_out: wp.array[wp.float64],
    acting_out: wp.array[wp.float64],
):
    """What edges, inertia and load make at each vertex.

    Args:
        gradient_out: Gradient; zero where a vertex is held.
        energy_out: Energy, half of each edge's.
        magnitude_out: Sum of the magnitudes of all forces.
        acting_out: Sum of the magnitudes of load and inertia alone, which the edges have to bear.
    """
    vertex = wp.tid()
    here = position[vertex]
    away = here - goal[vertex]
    push = inertia[vertex] * away
    gradient = push - load[vertex]
    energy = wp.float64(0.5) * inertia[vertex] * wp.dot(away, away) - wp.dot(load[vertex], here)
    magnitude = wp.length(load[vertex]) + wp.length(push)
    acting_out[vertex] = magnitude
    for k in range(vertex_edge_start[vertex], vertex_edge_start[vertex + 1]):
        edge = vertex_edges[k]
        along = here - position[vertex_neighbors[k]]
        length = wp.length(along)
        stretch = length - edge_target_length[edge]
        pull = edge_strength[edge] * stretch
        gradient += along * (pull / wp.max(length, wp.float64(1.0e-12)))
        energy += wp.float64(0.25) * pull * stretch
        magnitude += wp.abs(pull)
    if pinned[vertex]:
        gradient = wp.vec3d()
    gradient_out[vertex] = gradient
    energy_out[vertex] = energy
    magnitude_out[vertex] = magnitude
