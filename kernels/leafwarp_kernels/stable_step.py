"""An upper bound of the squared frequencies of the mesh, vertex by vertex, for the choice of the time step.

The stiffness of the mesh is a sum over springs, each bounded by the Cauchy-Schwarz inequality by terms that
couple no vertices: an edge by ``(u.(x_i - x_j))^2 <= 2 (u.x_i)^2 + 2 (u.x_j)^2``, a hinge with the gradients
``g_j`` by ``(sum_j g_j.x_j)^2 <= G sum_j (g_j.x_j)^2 / |g_j|``, ``G = sum_j |g_j|``. What remains is one
3 x 3 matrix ``S_i`` a vertex, and every squared frequency is at most the largest eigenvalue of ``S_i / m_i``
over the free vertices.

To it come the parts of the stiffness that the present forces make: a stretched edge holds its direction with
``k (1 - l / L)`` across it (a compressed one only weakens the mesh), a hinge bent by ``theta - theta0`` adds
``k (theta - theta0)`` times the second derivative of the angle, whose eigenvalues lie within 0.7 of the
diagonal ``h_j sum h``, with ``h_c``, ``h_d`` the inverse heights,
``h_a = |1 - s| h_c + |1 - t| h_d + 1 / |e|`` and ``h_b`` alike (found at most 0.67 over random hinges of
every angle, with feet and heights far outside those of a leaf mesh).

Where a mass, a stiffness, a rest length or an angle cannot be, neither the bound nor the stretch is a number.
"""

from typing import Any

import warp as wp

from leafwarp_kernels.dihedral import dihedral, reachable
from leafwarp_kernels.guards import if_finite, non_negative, positive

wp.set_module_options({"enable_backward": False})


@wp.func
def largest_eigenvalue(matrix: Any):
    """Largest eigenvalue of a symmetric positive semidefinite 3 x 3 matrix, in closed form."""
    zero = type(matrix[0, 0])(0.0)
    one = type(zero)(1.0)
    mean = (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) / type(zero)(3.0)
    if not (mean > zero):
        return zero
    xx = matrix[0, 0] / mean - one
    yy = matrix[1, 1] / mean - one
    zz = matrix[2, 2] / mean - one
    xy = matrix[0, 1] / mean
    xz = matrix[0, 2] / mean
    yz = matrix[1, 2] / mean
    square = xx * xx + yy * yy + zz * zz + type(zero)(2.0) * (xy * xy + xz * xz + yz * yz)
    spread = wp.sqrt(square / type(zero)(6.0))
    if not (spread > type(zero)(1.0e-6)):
        return mean * (one + spread)
    determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    cosine = wp.clamp(determinant / (type(zero)(2.0) * spread * spread * spread), -one, one)
    return mean * (one + type(zero)(2.0) * spread * wp.cos(wp.acos(cosine) / type(zero)(3.0)))


@wp.func
def edge_bound(
    vertex: wp.int32,
    position: wp.array[Any],
    vertex_edge_start: wp.array[wp.int32],
    vertex_edges: wp.array[wp.int32],
    vertex_neighbors: wp.array[wp.int32],
    edge_rest_length: wp.array[Any],
    edge_stiffness: wp.array[Any],
):
    """The edges' part of ``S_i``, and the scalar that the stretched ones add in every direction."""
    here = position[vertex]
    bound = wp.outer(here, here) * edge_stiffness.dtype(0.0)
    across = edge_stiffness.dtype(0.0)
    for k in range(vertex_edge_start[vertex], vertex_edge_start[vertex + 1]):
        edge = vertex_edges[k]
        along = here - position[vertex_neighbors[k]]
        inverse = edge_stiffness.dtype(1.0) / wp.max(wp.length(along), edge_stiffness.dtype(1.0e-12))
        stiffness = edge_stiffness.dtype(2.0) * non_negative(edge_stiffness[edge])
        stretch = wp.max(edge_stiffness.dtype(0.0), edge_stiffness.dtype(1.0) - edge_rest_length[edge] * inverse)
        direction = along * inverse
        bound += wp.outer(direction, direction) * (stiffness * (edge_stiffness.dtype(1.0) - stretch))
        across += stiffness * stretch
    return bound, across


@wp.kernel
def edge_frequencies(
    # inputs:
    position: wp.array[Any],
    mass: wp.array[wp.Float],
    pinned: wp.array[wp.bool],
    vertex_edge_start: wp.array[wp.int32],
    vertex_edges: wp.array[wp.int32],
    vertex_neighbors: wp.array[wp.int32],
    edge_rest_length: wp.array[wp.Float],
    edge_stiffness: wp.array[wp.Float],
    # outputs:
    squared_frequency_out: wp.array[wp.Float],
):
    """Bound of each vertex [1/s^2] in a mesh of edge springs alone; 0 where pinned."""
    vertex = wp.tid()
    squared = edge_stiffness.dtype(0.0)
    if not pinned[vertex]:
        bound, across = edge_bound(
            vertex,
            position,
            vertex_edge_start,
            vertex_edges,
            vertex_neighbors,
            edge_rest_length,
            edge_stiffness,
        )
        squared = (largest_eigenvalue(bound) + across) / positive(mass[vertex])
    squared_frequency_out[vertex] = squared


@wp.kernel
def hinge_bounds(
    # inputs:
    position: wp.array[Any],
    hinge_vertices: wp.array2d[wp.int32],
    hinge_angle: wp.array[wp.Float],
    hinge_rest_angle: wp.array[wp.Float],
    hinge_stiffness: wp.array[wp.Float],
    # outputs:
    hinge_row_out: wp.array[Any],
    hinge_tension_out: wp.array[wp.Float],
):
    """What each hinge adds at its four vertices: a vector whose outer square goes to ``S_i``, and a scalar."""
    hinge = wp.tid()
    a = position[hinge_vertices[hinge, 0]]
    b = position[hinge_vertices[hinge, 1]]
    _angle, gradient_c, gradient_d, foot_c, foot_d = dihedral(
        a, b, position[hinge_vertices[hinge, 2]], position[hinge_vertices[hinge, 3]]
    )
    gradient_b = -(foot_c * gradient_c + foot_d * gradient_d)
    gradient_a = -(gradient_c + gradient_d + gradient_b)
    stiffness = non_negative(hinge_stiffness[hinge])
    one = type(stiffness)(1.0)
    tiny = type(stiffness)(1.0e-12)
    steep_a = wp.length(gradient_a)
    steep_b = wp.length(gradient_b)
    steep_c = wp.length(gradient_c)
    steep_d = wp.length(gradient_d)
    total = stiffness * (steep_a + steep_b + steep_c + steep_d)
    hinge_row_out[4 * hinge] = gradient_a * wp.sqrt(total / wp.max(steep_a, tiny))
    hinge_row_out[4 * hinge + 1] = gradient_b * wp.sqrt(total / wp.max(steep_b, tiny))
    hinge_row_out[4 * hinge + 2] = gradient_c * wp.sqrt(total / wp.max(steep_c, tiny))
    hinge_row_out[4 * hinge + 3] = gradient_d * wp.sqrt(total / wp.max(steep_d, tiny))

    inverse = one / wp.max(wp.length(b - a), tiny)
    curved_a = wp.abs(one - foot_c) * steep_c + wp.abs(one - foot_d) * steep_d + inverse
    curved_b = wp.abs(foot_c) * steep_c + wp.abs(foot_d) * steep_d + inverse
    rest_angle = hinge_rest_angle[hinge]
    moment = stiffness * wp.abs(hinge_angle[hinge] - if_finite(reachable(rest_angle), rest_angle))
    share = type(stiffness)(0.7) * moment * (curved_a + curved_b + steep_c + steep_d)
    if steep_c == type(stiffness)(0.0):
        share = type(stiffness)(0.0) * moment
    hinge_tension_out[4 * hinge] = share * curved_a
    hinge_tension_out[4 * hinge + 1] = share * curved_b
    hinge_tension_out[4 * hinge + 2] = share * steep_c
    hinge_tension_out[4 * hinge + 3] = share * steep_d


@wp.kernel
def edge_and_hinge_frequencies(
    # inputs:
    position: wp.array[Any],
    mass: wp.array[wp.Float],
    pinned: wp.array[wp.bool],
    vertex_edge_start: wp.array[wp.int32],
    vertex_edges: wp.array[wp.int32],
    vertex_neighbors: wp.array[wp.int32],
    edge_rest_length: wp.array[wp.Float],
    edge_stiffness: wp.array[wp.Float],
    vertex_hinge_start: wp.array[wp.int32],
    vertex_hinge_slots: wp.array[wp.int32],
    hinge_row: wp.array[Any],
    hinge_tension: wp.array[wp.Float],
    # outputs:
    squared_frequency_out: wp.array[wp.Float],
):
    """Bound of each vertex [1/s^2] in a mesh of edge and angular springs; 0 where pinned."""
    vertex = wp.tid()
    squared = edge_stiffness.dtype(0.0)
    if not pinned[vertex]:
        bound, across = edge_bound(
            vertex,
            position,
            vertex_edge_start,
            vertex_edges,
            vertex_neighbors,
            edge_rest_length,
            edge_stiffness,
        )
        for k in range(vertex_hinge_start[vertex], vertex_hinge_start[vertex + 1]):
            slot = vertex_hinge_slots[k]
            bound += wp.outer(hinge_row[slot], hinge_row[slot])
            across += hinge_tension[slot]
        squared = (largest_eigenvalue(bound) + across) / positive(mass[vertex])
    squared_frequency_out[vertex] = squared


@wp.kernel
def travel(
    # inputs:
    position: wp.array[Any],
    velocity: wp.array[Any],
    saved_position: wp.array[Any],
    # outputs:
    travel_out: wp.array[wp.Float],
):
    """How far each vertex has gone since it was saved [m]; not finite where its position or velocity is not."""
    vertex = wp.tid()
    distance = wp.length(position[vertex] - saved_position[vertex])
    if not wp.isfinite(wp.length(velocity[vertex])):
        distance = travel_out.dtype(wp.inf)
    travel_out[vertex] = distance


@wp.kernel
def edge_stretch(
    # inputs:
    position: wp.array[Any],
    edge_vertices: wp.array2d[wp.int32],
    edge_rest_length: wp.array[wp.Float],
    # outputs:
    stretch_out: wp.array[wp.Float],
):
    """Length of each edge over its rest length; 0 for an edge whose rest length is 0."""
    edge = wp.tid()
    rest_length = non_negative(edge_rest_length[edge])
    stretch = stretch_out.dtype(0.0)
    if rest_length != stretch:
        stretch = wp.length(position[edge_vertices[edge, 1]] - position[edge_vertices[edge, 0]]) / rest_length
    stretch_out[edge] = stretch
