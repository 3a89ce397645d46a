"""Vertex normals: the mean of the adjacent triangles' normals, weighted by area, of unit length."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def vertex_normals(
    # inputs:
    position: wp.array[Any],
    triangle_vertices: wp.array2d[wp.int32],
    vertex_triangle_start: wp.array[wp.int32],
    vertex_triangles: wp.array[wp.int32],
    # outputs:
    normal_out: wp.array[Any],
):
    """Unit normals on the photographed side; straight up where a vertex's triangles have no area."""
    vertex = wp.tid()
    total = position[vertex] - position[vertex]
    for slot in range(vertex_triangle_start[vertex], vertex_triangle_start[vertex + 1]):
        triangle = vertex_triangles[slot]
        a = position[triangle_vertices[triangle, 0]]
        b = position[triangle_vertices[triangle, 1]]
        c = position[triangle_vertices[triangle, 2]]
        total += wp.cross(b - a, c - a)
    size = wp.length(total)
    if size > type(size)(0.0):
        normal_out[vertex] = total / size
    else:
        total[2] = type(size)(1.0)
        normal_out[vertex] = total
