"""The potential that a step of implicit motion minimises, and its gradient.

    Phi(x) = sum over edges  k/2 (L - l)^2  +  sum over hinges  k/2 (theta - theta0)^2
             + sum over vertices  w/2 |x - x*|^2 - f.x,

with the dihedral angle ``theta`` of :mod:`leafwarp_kernels.dihedral`. The inertia ``w = m / dt^2`` draws each vertex
to where it would go on its own, ``x*``; ``f`` is a dead load such as the weight. Every hinge writes what belongs to
it, and every vertex sums its edges and hinges in a fixed order: no atomics, and the same bits in every run.

Explicit motion lets the forces of a thin triangle fade, for the sake of its step. Here they must be the potential's
gradient, and only those of a triangle without any height are limited.
"""

import warp as wp

from leafwarp_kernels.dihedral import angle_between, continued

wp.set_module_options({"enable_backward": False})

# Height of a triangle over its edge at which it counts as one without any.
COLLAPSED = wp.constant(wp.float64(1.0e-8))


@wp.kernel
def hinge_potential(
    # inputs:
    position: wp.array[wp.vec3d],
    hinge_vertices: wp.array2d[wp.int32],
    hinge_target_angle: wp.array[wp.float64],
    hinge_strength: wp.array[wp.float64],
    hinge_angle: wp.array[wp.float64],
    # outputs:
    hinge_trial_angle_out: wp.array[wp.float64],
    hinge_gradient_out: wp.array[wp.vec3d],
):
    """Each hinge's angle, continued from the one that it has, and the gradient of its energy at its vertices."""
    hinge = wp.tid()
    a = position[hinge_vertices[hinge, 0]]
    b = position[hinge_vertices[hinge, 1]]
    c = position[hinge_vertices[hinge, 2]]
    d = position[hinge_vertices[hinge, 3]]
    edge = b - a
    side_c = c - a
    side_d = d - a
    normal_c = wp.cross(edge, side_c)
    normal_d = wp.cross(side_d, edge)
    square = wp.max(wp.dot(edge, edge), wp.float64(1.0e-30))
    length = wp.sqrt(square)
    angle = angle_between(length * wp.dot(side_c, normal_d), wp.dot(normal_c, normal_d))
    angle = continued(angle, hinge_angle[hinge])
    floor = COLLAPSED * COLLAPSED * square * square
    gradient_c = normal_c * (length / wp.max(wp.dot(normal_c, normal_c), floor))
    gradient_d = normal_d * (length / wp.max(wp.dot(normal_d, normal_d), floor))
    foot_c = wp.dot(side_c, edge) / square
    foot_d = wp.dot(side_d, edge) / square
    hinge_trial_angle_out[hinge] = angle
    moment = hinge_strength[hinge] * (angle - hinge_target_angle[hinge])
    on_c = moment * gradient_c
    on_d = moment * gradient_d
    on_b = -(foot_c * on_c + foot_d * on_d)
    hinge_gradient_out[4 * hinge] = -(on_b + on_c + on_d)
    hinge_gradient_out[4 * hinge + 1] = on_b
    hinge_gradient_out[4 * hinge + 2] = on_c
    hinge_gradient_out[4 * hinge + 3] = on_d


@wp.func
def edges_and_inertia(
    vertex: wp.int32,
    position: wp.array[wp.vec3d],
    vertex_edge_start: wp.array[wp.int32],
    vertex_edges: wp.array[wp.int32],
    vertex_neighbors: wp.array[wp.int32],
    edge_target_length: wp.array[wp.float64],
    edge_strength: wp.array[wp.float64],
    inertia: wp.array[wp.float64],
    goal: wp.array[wp.vec3d],
    load: wp.array[wp.vec3d],
):
    """Gradient, energy (half of each edge's) and sum of the forces' magnitudes at a vertex, hinges left out."""
    here = position[vertex]
    away = here - goal[vertex]
    gradient = inertia[vertex] * away - load[vertex]
    energy = wp.float64(0.5) * inertia[vertex] * wp.dot(away, away) - wp.dot(load[vertex], here)
    magnitude = wp.length(load[vertex])
    for k in range(vertex_edge_start[vertex], vertex_edge_start[vertex + 1]):
        edge = vertex_edges[k]
        along = here - position[vertex_neighbors[k]]
        length = wp.length(along)
        stretch = length - edge_target_length[edge]
        pull = edge_strength[edge] * stretch
        gradient += along * (pull / wp.max(length, wp.float64(1.0e-12)))
        energy += wp.float64(0.25) * pull * stretch
        magnitude += wp.abs(pull)
    return gradient, energy, magnitude


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
):
    """Gradient, energy and magnitude of forces at each vertex without hinges; no gradient where it is held."""
    vertex = wp.tid()
    gradient, energy, magnitude = edges_and_inertia(
        vertex,
        position,
        vertex_edge_start,
        vertex_edges,
        vertex_neighbors,
        edge_target_length,
        edge_strength,
        inertia,
        goal,
        load,
    )
    if pinned[vertex]:
        gradient = wp.vec3d()
    gradient_out[vertex] = gradient
    energy_out[vertex] = energy
    magnitude_out[vertex] = magnitude


@wp.kernel
def sheet_gradient(
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
    vertex_hinge_start: wp.array[wp.int32],
    vertex_hinge_slots: wp.array[wp.int32],
    hinge_gradient: wp.array[wp.vec3d],
    hinge_trial_angle: wp.array[wp.float64],
    hinge_target_angle: wp.array[wp.float64],
    hinge_strength: wp.array[wp.float64],
    # outputs:
    gradient_out: wp.array[wp.vec3d],
    energy_out: wp.array[wp.float64],
    magnitude_out: wp.array[wp.float64],
):
    """The same with hinges, of whose energy each of the four vertices has a quarter.

    Slot ``4 h + j`` holds the gradient of hinge ``h`` at its vertex ``j``.
    """
    vertex = wp.tid()
    gradient, energy, magnitude = edges_and_inertia(
        vertex,
        position,
        vertex_edge_start,
        vertex_edges,
        vertex_neighbors,
        edge_target_length,
        edge_strength,
        inertia,
        goal,
        load,
    )
    for k in range(vertex_hinge_start[vertex], vertex_hinge_start[vertex + 1]):
        slot = vertex_hinge_slots[k]
        hinge = slot / 4
        turned = hinge_trial_angle[hinge] - hinge_target_angle[hinge]
        gradient += hinge_gradient[slot]
        energy += wp.float64(0.125) * hinge_strength[hinge] * turned * turned
        magnitude += wp.length(hinge_gradient[slot])
    if pinned[vertex]:
        gradient = wp.vec3d()
    gradient_out[vertex] = gradient
    energy_out[vertex] = energy
    magnitude_out[vertex] = magnitude
