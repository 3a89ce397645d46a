"""The water at a moment between two fluid steps."""

import warp as wp

from leafwarp_kernels.lanes import Lanes

wp.set_module_options({"enable_backward": False})


@wp.kernel
def interpolate_water(
    # inputs:
    water_before: wp.array2d[Lanes],
    water: wp.array2d[Lanes],
    share: wp.Float,
    # outputs:
    water_now_out: wp.array2d[Lanes],
):
    """Blend linearly from the start of the last fluid step to its end; exact at both.

    Args:
        water_before: Relative water content before the last step, shape [row, block].
        water: After it.
        share: Part of the step that has passed, in [0, 1].
        water_now_out: The blend.
    """
    row, block = wp.tid()
    rest = type(share)(1.0) - share
    water_now_out[row, block] = rest * water_before[row, block] + share * water[row, block]
