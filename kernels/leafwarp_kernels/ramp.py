"""What follows the water goes from one coupling to the next in a straight line of the playback time that ends with it
(a frame at most), not in a jump::

    p(s) = (1 - s) p_before + s p_after                                    s = share of the span that has passed

A jump a frame is a blow at the frame rate, and a leaf that nothing calms rings with it. A few substeps share a value,
that of their middle. All parameters pass in one launch; those that do not follow the water are empty arrays.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def blend(i: wp.int32, share: Any, before: wp.array[Any], after: wp.array[Any], parameter_out: wp.array[Any]):
    """One value on its way, where there is one."""
    if i < parameter_out.shape[0]:
        parameter_out[i] = (share.dtype(1.0) - share) * before[i] + share * after[i]


@wp.func
def copy(i: wp.int32, parameter: wp.array[Any], parameter_out: wp.array[Any]):
    """One value, where there is one."""
    if i < parameter_out.shape[0]:
        parameter_out[i] = parameter[i]


@wp.kernel
def ramp(
    # inputs:
    clock: wp.array[wp.Float],
    substeps: wp.Float,
    rest_length_before: wp.array[wp.Float],
    rest_length_after: wp.array[wp.Float],
    rest_angle_before: wp.array[wp.Float],
    rest_angle_after: wp.array[wp.Float],
    edge_stiffness_before: wp.array[wp.Float],
    edge_stiffness_after: wp.array[wp.Float],
    hinge_stiffness_before: wp.array[wp.Float],
    hinge_stiffness_after: wp.array[wp.Float],
    mass_before: wp.array[wp.Float],
    mass_after: wp.array[wp.Float],
    # outputs:
    rest_length_out: wp.array[wp.Float],
    rest_angle_out: wp.array[wp.Float],
    edge_stiffness_out: wp.array[wp.Float],
    hinge_stiffness_out: wp.array[wp.Float],
    mass_out: wp.array[wp.Float],
):
    """Every parameter, ``substeps`` after the share of the span that has passed: ``clock[0]``, each ``clock[1]``."""
    i = wp.tid()
    share = wp.min(clock.dtype(1.0), clock[0] + substeps * clock[1])
    blend(i, share, rest_length_before, rest_length_after, rest_length_out)
    blend(i, share, rest_angle_before, rest_angle_after, rest_angle_out)
    blend(i, share, edge_stiffness_before, edge_stiffness_after, edge_stiffness_out)
    blend(i, share, hinge_stiffness_before, hinge_stiffness_after, hinge_stiffness_out)
    blend(i, share, mass_before, mass_after, mass_out)


@wp.kernel
def pass_substeps(
    # inputs:
    substeps: wp.Float,
    # in and out:
    clock: wp.array[wp.Float],
):
    """Let ``substeps`` of the span pass; one thread."""
    clock[0] = clock[0] + substeps * clock[1]


@wp.kernel
def keep(
    # inputs:
    rest_length: wp.array[wp.Float],
    rest_angle: wp.array[wp.Float],
    edge_stiffness: wp.array[wp.Float],
    hinge_stiffness: wp.array[wp.Float],
    mass: wp.array[wp.Float],
    # outputs:
    rest_length_out: wp.array[wp.Float],
    rest_angle_out: wp.array[wp.Float],
    edge_stiffness_out: wp.array[wp.Float],
    hinge_stiffness_out: wp.array[wp.Float],
    mass_out: wp.array[wp.Float],
):
    """Copy every parameter, in one launch: a copy each takes a tenth of a coarse film's motion."""
    i = wp.tid()
    copy(i, rest_length, rest_length_out)
    copy(i, rest_angle, rest_angle_out)
    copy(i, edge_stiffness, edge_stiffness_out)
    copy(i, hinge_stiffness, hinge_stiffness_out)
    copy(i, mass, mass_out)
