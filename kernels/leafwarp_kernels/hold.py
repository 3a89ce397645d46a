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
    vertex_start: wp.array[wp.int32],
    vertices: wp.array[wp.int32],
    position_start: wp.array[Any],
    pinned: wp.array[wp.bool],
    spring_start: wp.array[wp.int32],
    springs: wp.array[wp.int32],
    rest_length_start: wp.array[wp.Float],
    rest_length: wp.array[wp.Float],
    # outputs:
    position_out: wp.array[Any],
):
    """Put the held vertices of one leaf where the shrinking takes them; leaf k's are ``vertices`` from
    ``vertex_start[k]`` on, its springs likewise."""
    leaf = wp.tid()
    total = rest_length.dtype(0.0)
    for spring in range(spring_start[leaf], spring_start[leaf + 1]):
        total += rest_length[springs[spring]] / rest_length_start[spring]
    scale = total / rest_length.dtype(spring_start[leaf + 1] - spring_start[leaf])
    for held in range(vertex_start[leaf], vertex_start[leaf + 1]):
        vertex = vertices[held]
        if pinned[vertex]:
            position_out[vertex] = scale * position_start[held]


@wp.kernel
def carry(
    # inputs:
    vertices: wp.array[wp.int32],
    pinned: wp.array[wp.bool],
    position: wp.array[Any],
    duration: wp.array[wp.Float],
    # in and out:
    position_before: wp.array[Any],
    # outputs:
    velocity_out: wp.array[Any],
):
    """Give one held vertex the mean velocity of a span of playback time, and remember where it is."""
    held = wp.tid()
    vertex = vertices[held]
    if pinned[vertex]:
        velocity_out[vertex] = (position[vertex] - position_before[held]) / duration[0]
    position_before[held] = position[vertex]
