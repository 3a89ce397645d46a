"""Second derivatives of the edge springs' energy ``k/2 (L - l)^2``.

With the direction ``u`` of an edge of length ``L`` and its tension ``T = k (L - l)``, its block is

    K = k u u^T + (T / L) (I - u u^T),

once with a plus at either end and once with a minus between them. A compressed edge has negative eigenvalues across
its direction; without them (``max(0, T)``) the block is the nearest positive semi-definite one.

The tension is an array of its own. A Newton step that turns a stiff edge by an angle ``a`` stretches it by ``a^2 / 2``,
and the tension of that stretch, which the next step takes away again, would hold the edge in its direction with far
more than bending and weight. So the tension that the step was to lead to is put in instead,

    T = k (L - l + u.(p_i - p_j)),

of a step ``p``: Newton's method for positions and tensions as unknowns on an equal footing, from which the
tensions have been eliminated (Magisano, Leonetti and Garcea 2017). At the solution both are the same.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def edge_tensions(
    # inputs:
    position: wp.array[wp.vec3d],
    direction: wp.array[wp.vec3d],
    edge_vertices: wp.array2d[wp.int32],
    edge_target_length: wp.array[wp.float64],
    edge_strength: wp.array[wp.float64],
    # outputs:
    edge_tension_out: wp.array[wp.float64],
):
    """Tension of each edge that a step is to lead to, to first order."""
    edge = wp.tid()
    i = edge_vertices[edge, 0]
    j = edge_vertices[edge, 1]
    along = position[i] - position[j]
    length = wp.max(wp.length(along), wp.float64(1.0e-12))
    stretch = length - edge_target_length[edge] + wp.dot(along, direction[i] - direction[j]) / length
    edge_tension_out[edge] = edge_strength[edge] * stretch


@wp.kernel
def excess_gradient(
    # inputs:
    position: wp.array[wp.vec3d],
    direction: wp.array[wp.vec3d],
    trial_position: wp.array[wp.vec3d],
    vertex_edge_start: wp.array[wp.int32],
    vertex_edges: wp.array[wp.int32],
    vertex_neighbors: wp.array[wp.int32],
    edge_strength: wp.array[wp.float64],
    pinned: wp.array[wp.bool],
    # outputs:
    gradient_out: wp.array[wp.vec3d],
):
    """Pull of what the edges are longer after a step than they should be to first order, in their old directions.

    A step that turns an edge stretches it to second order; taking this pull away with the Hessian of the start gives
    the step's second-order correction.
    """
    vertex = wp.tid()
    gradient = wp.vec3d()
    if not pinned[vertex]:
        for k in range(vertex_edge_start[vertex], vertex_edge_start[vertex + 1]):
            other = vertex_neighbors[k]
            along = position[vertex] - position[other]
            length = wp.max(wp.length(along), wp.float64(1.0e-12))
            unit = along / length
            meant = length + wp.dot(unit, direction[vertex] - direction[other])
            excess = wp.length(trial_position[vertex] - trial_position[other]) - meant
            gradient += unit * (edge_strength[vertex_edges[k]] * excess)
    gradient_out[vertex] = gradient


@wp.kernel
def edge_blocks(
    # inputs:
    position: wp.array[wp.vec3d],
    edge_vertices: wp.array2d[wp.int32],
    edge_strength: wp.array[wp.float64],
    edge_tension: wp.array[wp.float64],
    convex: wp.bool,
    # outputs:
    edge_block_out: wp.array2d[wp.vec3d],
):
    """Rows of each edge's block, shape [edge_count, 3]."""
    edge = wp.tid()
    along = position[edge_vertices[edge, 0]] - position[edge_vertices[edge, 1]]
    length = wp.max(wp.length(along), wp.float64(1.0e-12))
    across = edge_tension[edge] / length
    if convex:
        across = wp.max(across, wp.float64(0.0))
    unit = along / length
    matrix = wp.outer(unit, unit) * (edge_strength[edge] - across)
    matrix += wp.identity(n=3, dtype=wp.float64) * across
    for row in range(3):
        edge_block_out[edge, row] = matrix[row]


@wp.kernel
def membrane_product(
    # inputs:
    position: wp.array[wp.vec3d],
    direction: wp.array[wp.vec3d],
    vertex_edge_start: wp.array[wp.int32],
    vertex_edges: wp.array[wp.int32],
    vertex_neighbors: wp.array[wp.int32],
    edge_strength: wp.array[wp.float64],
    edge_tension: wp.array[wp.float64],
    inertia: wp.array[wp.float64],
    pinned: wp.array[wp.bool],
    # outputs:
    product_out: wp.array[wp.vec3d],
):
    """Hessian of edges and inertia times a direction, which is zero where a vertex is held."""
    vertex = wp.tid()
    here = position[vertex]
    moved = direction[vertex]
    product = inertia[vertex] * moved
    for k in range(vertex_edge_start[vertex], vertex_edge_start[vertex + 1]):
        edge = vertex_edges[k]
        other = vertex_neighbors[k]
        along = here - position[other]
        apart = moved - direction[other]
        inverse = wp.float64(1.0) / wp.max(wp.length(along), wp.float64(1.0e-12))
        across = edge_tension[edge] * inverse
        axial = (edge_strength[edge] - across) * inverse * inverse * wp.dot(along, apart)
        product += along * axial + apart * across
    if pinned[vertex]:
        product = wp.vec3d()
    product_out[vertex] = product
