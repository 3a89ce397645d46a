"""The Hessian's blocks, summed from those of edges and hinges into a fixed pattern, each in a fixed order."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def edges_block(
    block: wp.int32,
    block_row: wp.array[wp.int32],
    block_is_diagonal: wp.array[wp.bool],
    block_edge_start: wp.array[wp.int32],
    block_edges: wp.array[wp.int32],
    edge_block: wp.array2d[wp.vec3d],
    inertia: wp.array[wp.float64],
):
    """Edges' and inertia's part of a block."""
    sign = wp.float64(-1.0)
    size = wp.float64(0.0)
    if block_is_diagonal[block]:
        sign = wp.float64(1.0)
        size = inertia[block_row[block]]
    total = wp.identity(n=3, dtype=wp.float64) * size
    for k in range(block_edge_start[block], block_edge_start[block + 1]):
        edge = block_edges[k]
        total += wp.matrix_from_rows(edge_block[edge, 0], edge_block[edge, 1], edge_block[edge, 2]) * sign
    return total


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
    """Blocks of a mesh without hinges, shape [block_count, 3]."""
    block = wp.tid()
    total = edges_block(block, block_row, block_is_diagonal, block_edge_start, block_edges, edge_block, inertia)
    for row in range(3):
        block_out[block, row] = total[row]


@wp.kernel
def sheet_blocks(
    # inputs:
    block_row: wp.array[wp.int32],
    block_is_diagonal: wp.array[wp.bool],
    block_edge_start: wp.array[wp.int32],
    block_edges: wp.array[wp.int32],
    edge_block: wp.array2d[wp.vec3d],
    inertia: wp.array[wp.float64],
    block_hinge_start: wp.array[wp.int32],
    block_hinge_slots: wp.array[wp.int32],
    hinge_block: wp.array2d[wp.vec3d],
    # outputs:
    block_out: wp.array2d[wp.vec3d],
):
    """The same with hinges. Slot ``2 k`` is block ``k`` of the hinges, slot ``2 k + 1`` its transpose."""
    block = wp.tid()
    total = edges_block(block, block_row, block_is_diagonal, block_edge_start, block_edges, edge_block, inertia)
    for k in range(block_hinge_start[block], block_hinge_start[block + 1]):
        slot = block_hinge_slots[k]
        place = slot / 2
        part = wp.matrix_from_rows(hinge_block[place, 0], hinge_block[place, 1], hinge_block[place, 2])
        if slot % 2 == 1:
            part = wp.transpose(part)
        total += part
    for row in range(3):
        block_out[block, row] = total[row]
