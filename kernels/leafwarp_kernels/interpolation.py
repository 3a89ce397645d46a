"""The water at a moment between two fluid steps."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def interpolate_water(
    # inputs:
    water_before: wp.array2d[wp.Float],
    water: wp.array2d[wp.Float],
    share: wp.Float,
    # outputs:
    water_now_out: wp.array2d[wp.Float],
):
    """Blend linearly from the start of the last fluid step to its end; exact at both.

    Args:
        water_before: Relative water content before the last step, shape [ny, nx].
        water: After it.
        share: Part of the step that has passed, in [0, 1].
        water_now_out: The blend.
    """
    row, column = wp.tid()
    rest = type(share)(1.0) - share
    water_now_out[row, column] = rest * water_before[row, column] + share * water[row, column]
