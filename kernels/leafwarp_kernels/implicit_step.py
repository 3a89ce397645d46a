"""What a step of implicit motion starts from and leaves behind.

Backward Euler over ``dt`` minimises (Martin et al. 2011), with the present positions and velocities ``x0``, ``v0``,

    m/(2 dt^2) |x - x0 - dt v0|^2 - m g.x + drag m/(2 dt) |x - x0 - dt wind|^2 + E(x) + tau/dt (E of the change),

where damping along springs is, for an edge of length ``L0`` at the start, ``k tau/(2 dt) (L - L0)^2``. Both
quadratics of a vertex are one about a goal, and both of a spring are one of another strength and rest length.

Where a mass, a stiffness, a rest length or an angle cannot be, what follows from it is not a number, nor is the energy.
"""

import warp as wp

from leafwarp_kernels.dihedral import reachable
from leafwarp_kernels.guards import if_finite, non_negative, positive

wp.set_module_options({"enable_backward": False})


@wp.kernel
def predict(
    # inputs:
    position: wp.array[wp.vec3d],
    velocity: wp.array[wp.vec3d],
    mass: wp.array[wp.float64],
    gravity: wp.vec3d,
    wind: wp.vec3d,
    drag: wp.float64,
    time_step: wp.array[wp.float64],
    # outputs:
    inertia_out: wp.array[wp.float64],
    goal_out: wp.array[wp.vec3d],
    load_out: wp.array[wp.vec3d],
):
    """Inertia ``w`` [N/m], goal ``x*`` [m] and load [N] of each vertex for a step of motion."""
    vertex = wp.tid()
    step = time_step[0]
    weighed = positive(mass[vertex])
    own = weighed / (step * step)
    air = drag * weighed / step
    here = position[vertex]
    way = (own * velocity[vertex] + air * wind) * (step / (own + air))
    inertia_out[vertex] = own + air
    goal_out[vertex] = here + way
    load_out[vertex] = weighed * gravity


@wp.kernel
def hang(
    # inputs:
    mass: wp.array[wp.float64],
    gravity: wp.vec3d,
    wind: wp.vec3d,
    drag: wp.float64,
    # outputs:
    load_out: wp.array[wp.vec3d],
):
    """Load of each vertex at rest [N]: its weight, and the push of the wind."""
    vertex = wp.tid()
    load_out[vertex] = positive(mass[vertex]) * (gravity + drag * wind)


@wp.kernel
def damp_edges(
    # inputs:
    position: wp.array[wp.vec3d],
    edge_vertices: wp.array2d[wp.int32],
    edge_rest_length: wp.array[wp.float64],
    edge_stiffness: wp.array[wp.float64],
    damping_share: wp.array[wp.float64],
    # outputs:
    edge_target_length_out: wp.array[wp.float64],
    edge_strength_out: wp.array[wp.float64],
):
    """Strength and rest length of each edge with its damping, ``c = tau / dt`` being ``damping_share``:
    ``k (1 + c)`` and ``(l + c L0) / (1 + c)``."""
    edge = wp.tid()
    share = damping_share[0]
    rest = non_negative(edge_rest_length[edge])
    total = wp.float64(1.0) + share
    if share > wp.float64(0.0):
        length = wp.length(position[edge_vertices[edge, 0]] - position[edge_vertices[edge, 1]])
        rest = (rest + share * length) / total
    edge_target_length_out[edge] = rest
    edge_strength_out[edge] = non_negative(edge_stiffness[edge]) * total


@wp.kernel
def damp_hinges(
    # inputs:
    hinge_angle: wp.array[wp.float64],
    hinge_rest_angle: wp.array[wp.float64],
    hinge_stiffness: wp.array[wp.float64],
    damping_share: wp.array[wp.float64],
    # outputs:
    hinge_target_angle_out: wp.array[wp.float64],
    hinge_strength_out: wp.array[wp.float64],
):
    """The same for hinges."""
    hinge = wp.tid()
    share = damping_share[0]
    total = wp.float64(1.0) + share
    rest_angle = hinge_rest_angle[hinge]
    rest = if_finite(reachable(rest_angle), rest_angle)
    hinge_target_angle_out[hinge] = (rest + share * hinge_angle[hinge]) / total
    hinge_strength_out[hinge] = non_negative(hinge_stiffness[hinge]) * total


@wp.kernel
def arrive(
    # inputs:
    trial_position: wp.array[wp.vec3d],
    pinned: wp.array[wp.bool],
    time_step: wp.array[wp.float64],
    # in and out:
    position: wp.array[wp.vec3d],
    # outputs:
    velocity_out: wp.array[wp.vec3d],
):
    """Take over the positions found, and the velocity that led there."""
    vertex = wp.tid()
    if pinned[vertex]:
        velocity_out[vertex] = wp.vec3d()
        return
    velocity_out[vertex] = (trial_position[vertex] - position[vertex]) / time_step[0]
    position[vertex] = trial_position[vertex]
