"""The hinges' part ``k/2 (theta - theta0)^2`` of the potential of implicit motion, and its gradient.

With the dihedral angle ``theta`` of :mod:`leafwarp_kernels.dihedral`. Every hinge writes what belongs to it, and every
vertex sums its hinges in a fixed order: no atomics, and the same bits in every run.

Explicit motion lets the forces of a thin triangle fade, for the sake of its step. Here they must be the potential's
gradient, and only those of a triangle without any height are limited.
"""

import warp as wp

from leafwarp_kernels.dihedral import angle_between, continued, sides_and_normals

wp.set_module_options({"enable_backward": False})

# Height of a triangle over its edge at which it counts as one without any.
COLLAPSED = wp.constant(wp.float64(1.0e-8))
# What the bending force of a vertex counts for beside load and inertia. On an irregular mesh of a stiff leaf it is many
# times the weight that it carries, from vertex to vertex; where nothing loads a curling leaf it is all there is.
BENDING_SHARE = wp.constant(wp.float64(0.01))


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
    edge, side_c, side_d, normal_c, normal_d = sides_and_normals(
        position[hinge_vertices[hinge, 0]],
        position[hinge_vertices[hinge, 1]],
        position[hinge_vertices[hinge, 2]],
        position[hinge_vertices[hinge, 3]],
    )
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


@wp.kernel
def add_hinge_gradients(
    # inputs:
    vertex_hinge_start: wp.array[wp.int32],
    vertex_hinge_slots: wp.array[wp.int32],
    hinge_gradient: wp.array[wp.vec3d],
    hinge_trial_angle: wp.array[wp.float64],
    hinge_target_angle: wp.array[wp.float64],
    hinge_strength: wp.array[wp.float64],
    pinned: wp.array[wp.bool],
    # in and out:
    gradient: wp.array[wp.vec3d],
    energy: wp.array[wp.float64],
    magnitude: wp.array[wp.float64],
    acting: wp.array[wp.float64],
):
    """Add what hinges make at each vertex: their gradients, a quarter of each one's energy, the magnitudes of their
    forces, and to what acts the magnitude of the sum of their forces, by its share.

    Slot ``4 h + j`` holds the gradient of hinge ``h`` at its vertex ``j``.
    """
    vertex = wp.tid()
    total = gradient[vertex]
    own = energy[vertex]
    size = magnitude[vertex]
    bend = wp.vec3d()
    for k in range(vertex_hinge_start[vertex], vertex_hinge_start[vertex + 1]):
        slot = vertex_hinge_slots[k]
        hinge = slot / 4
        turned = hinge_trial_angle[hinge] - hinge_target_angle[hinge]
        total += hinge_gradient[slot]
        bend += hinge_gradient[slot]
        own += wp.float64(0.125) * hinge_strength[hinge] * turned * turned
        size += wp.length(hinge_gradient[slot])
    if not pinned[vertex]:
        gradient[vertex] = total
    energy[vertex] = own
    magnitude[vertex] = size
    acting[vertex] = acting[vertex] + BENDING_SHARE * wp.length(bend)
