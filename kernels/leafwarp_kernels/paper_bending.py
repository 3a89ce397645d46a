"""The paper's bending force, Eq. (4): a push on the two opposite vertices along their triangles' normals.

    F_c = -k (theta - theta0) / arm * n1 / |n1|,      F_d = -k (theta - theta0) / arm * n2 / |n2|,

with the continuous angle of :mod:`leafwarp_kernels.dihedral` (flat is 0), damped as the angular springs are.
The edge's two vertices take half of the reaction each, which the printed force lacks, so that linear momentum
is conserved. Angular momentum is not: ``arm``, the mean height of the hinge's two triangles at rest, makes
the force equal to the energy's gradient only where both heights are the arm and both feet halve the edge.
"""

from typing import Any

import warp as wp

from leafwarp_kernels.dihedral import continued, dihedral, reachable

wp.set_module_options({"enable_backward": False})


@wp.kernel
def paper_bending_forces(
    # inputs:
    position: wp.array[Any],
    velocity: wp.array[Any],
    hinge_vertices: wp.array2d[wp.int32],
    hinge_arm: wp.array[wp.Float],
    hinge_rest_angle: wp.array[wp.Float],
    hinge_stiffness: wp.array[wp.Float],
    damping_time: wp.array[wp.Float],
    # in and out:
    hinge_angle: wp.array[wp.Float],
    # outputs:
    hinge_force_out: wp.array[Any],
):
    """Forces of each hinge on its four vertices, and its angle, continued from the one before."""
    hinge = wp.tid()
    a = hinge_vertices[hinge, 0]
    b = hinge_vertices[hinge, 1]
    c = hinge_vertices[hinge, 2]
    d = hinge_vertices[hinge, 3]
    angle, gradient_c, gradient_d, foot_c, foot_d = dihedral(position[a], position[b], position[c], position[d])
    angle = continued(angle, hinge_angle[hinge])
    hinge_angle[hinge] = angle
    base = velocity[a]
    slope = velocity[b] - base
    rate = wp.dot(gradient_c, velocity[c] - base - foot_c * slope)
    rate += wp.dot(gradient_d, velocity[d] - base - foot_d * slope)
    moment = -hinge_stiffness[hinge] * (angle - reachable(hinge_rest_angle[hinge]) + damping_time[0] * rate)
    push = moment / hinge_arm[hinge]
    force_c = push * wp.normalize(gradient_c)
    force_d = push * wp.normalize(gradient_d)
    reaction = type(push)(-0.5) * (force_c + force_d)
    hinge_force_out[4 * hinge] = reaction
    hinge_force_out[4 * hinge + 1] = reaction
    hinge_force_out[4 * hinge + 2] = force_c
    hinge_force_out[4 * hinge + 3] = force_d
