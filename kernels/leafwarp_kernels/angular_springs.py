"""Angular springs: the gradient of their energy (paper, Alg. 1 and 2, made continuous and conservative).

A hinge with the dihedral angle ``theta`` (see :mod:`leafwarp_kernels.dihedral`) holds
``k/2 (theta - theta0)^2`` and resists its rate of change with the damping time ``tau``:

    F_j = -(k (theta - theta0) + tau k dtheta/dt) grad_j theta,
    dtheta/dt = sum over the four vertices of grad_j theta . v_j.

The paper's Alg. 2 adds pi to the angle of a fold on the far side, which jumps at the flat state; its Eq. (4)
pushes only the two opposite vertices. The gradient also pulls the edge's own, and conserves linear and
angular momentum.
"""

from typing import Any

import warp as wp

from leafwarp_kernels.dihedral import continued, dihedral, reachable

wp.set_module_options({"enable_backward": False})


@wp.kernel
def angular_spring_forces(
    # inputs:
    position: wp.array[Any],
    velocity: wp.array[Any],
    hinge_vertices: wp.array2d[wp.int32],
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
    force_c = moment * gradient_c
    force_d = moment * gradient_d
    force_b = -(foot_c * force_c + foot_d * force_d)
    hinge_force_out[4 * hinge] = -(force_b + force_c + force_d)
    hinge_force_out[4 * hinge + 1] = force_b
    hinge_force_out[4 * hinge + 2] = force_c
    hinge_force_out[4 * hinge + 3] = force_d
