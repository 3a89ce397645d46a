"""The Hessian's blocks, summed from those of the edges into a fixed pattern, each in a fixed order."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def membrane_blocks(
    # inputs:
    block_row: wp.array[wp.int32],
    block_is_diagonal: wp.array[wp.bool],
    block_edge_start: wp.array[wp.int32],
    block_edges: wp.array[wp.int32],
    edge_block: wp.array2d[wp.vec3d],
    inertia: wp.array[wp.float64],
    # outputs:
    block_out: wp.array2d[wp.vec3d],
):
    """Blocks of edges and inertia, shape [block_count, 3]."""
    block = wp.tid()
    sign = wp.float64(-1.0)
    size = wp.float64(0.0)
    if block_is_diagonal[block]:
        sign = wp.float64(1.0)
        size = inertia[block_row[block]]
    total = wp.identity(n=3, dtype=wp.float64) * size
    for k in range(block_edge_start[block], block_edge_start[block + 1]):
        edge = block_edges[k]
        total += wp.matrix_from_rows(edge_block[edge, 0], edge_block[edge, 1], edge_block[edge, 2]) * sign
    for row in range(3):
        block_out[block, row] = total[row]
