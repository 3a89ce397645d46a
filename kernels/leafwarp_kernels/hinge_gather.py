"""Forces of hinges summed at their vertices, and the torque that they leave unbalanced."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def gather_hinge_forces(
    # inputs:
    vertex_hinge_start: wp.array[wp.int32],
    vertex_hinge_slots: wp.array[wp.int32],
    hinge_force: wp.array[Any],
    # in and out:
    force: wp.array[Any],
):
    """Add to each vertex's force those of its hinges, in a fixed order.

    Slot ``4 h + j`` holds the force of hinge ``h`` on its vertex ``j``.
    """
    vertex = wp.tid()
    total = force[vertex]
    for k in range(vertex_hinge_start[vertex], vertex_hinge_start[vertex + 1]):
        total += hinge_force[vertex_hinge_slots[k]]
    force[vertex] = total


@wp.kernel
def hinge_torque(
    # inputs:
    position: wp.array[Any],
    hinge_vertices: wp.array2d[wp.int32],
    hinge_force: wp.array[Any],
    # outputs:
    hinge_torque_out: wp.array[Any],
):
    """Torque of each hinge's four forces about its first vertex; about any point where the forces sum to zero."""
    hinge = wp.tid()
    origin = position[hinge_vertices[hinge, 0]]
    torque = hinge_torque_out.dtype()
    for j in range(1, 4):
        torque += wp.cross(position[hinge_vertices[hinge, j]] - origin, hinge_force[4 * hinge + j])
    hinge_torque_out[hinge] = torque
