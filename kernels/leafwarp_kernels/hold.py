"""Where a leaf that shrinks is held: its held tissue shrinks about the petiole's base as the springs around it do::

    x = s x_start,    s = mean over the springs that touch held vertices of l / l_start

Without it the held vertices would stay as far apart as in the photo and strain what grows from them, by how many of
them a mesh has and where, and so turn the whole leaf.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def hold(
    # inputs:
    vertices: wp.array[wp.int32],
    leaves: wp.array[wp.int32],
    position_start: wp.array[Any],
    pinned: wp.array[wp.bool],
    edge_start: wp.array[wp.int32],
    edges: wp.array[wp.int32],
    rest_length_start: wp.array[wp.Float],
    rest_length: wp.array[wp.Float],
    # outputs:
    position_out: wp.array[Any],
):
    """Put one held vertex where the shrinking takes it; leaf k has the springs ``edges`` from ``edge_start[k]`` on."""
    held = wp.tid()
    vertex = vertices[held]
    if not pinned[vertex]:
        return
    first = edge_start[leaves[held]]
    last = edge_start[leaves[held] + 1]
    total = rest_length.dtype(0.0)
    for spring in range(first, last):
        total += rest_length[edges[spring]] / rest_length_start[spring]
    position_out[vertex] = (total / rest_length.dtype(last - first)) * position_start[held]
