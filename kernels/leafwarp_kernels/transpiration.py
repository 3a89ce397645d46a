"""Water lost through the surface of the leaf.

In a step dt each cell loses ``min(y, (cuticle + stomatal) dt)``: a sink never takes more than is there. One
thread takes one row of the map and adds up in float64 what really left the stored contents, so that the
ledger closes.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def transpire(
    # inputs:
    cuticle_rate: wp.Float,
    stomatal_rate: wp.array2d[wp.Float],
    time_step: wp.Float,
    # outputs:
    water_out: wp.array2d[wp.Float],
    transpired_out: wp.array[wp.float64],
):
    """Take what transpires in a step.

    Args:
        cuticle_rate: Loss everywhere alike [1/s].
        stomatal_rate: Further loss of each cell [1/s], shape [ny, nx]; None for none.
        time_step: [s].
        water_out: Relative water content, shape [ny, nx]; cells off the leaf hold 0 and keep it.
        transpired_out: Sum of the contents taken from each row so far, shape [ny]; added to.
    """
    row = wp.tid()
    taken = wp.float64(0.0)
    for column in range(water_out.shape[1]):
        content = water_out[row, column]
        loss = cuticle_rate * time_step
        if stomatal_rate:
            loss += stomatal_rate[row, column] * time_step
        remaining = content - wp.min(loss, wp.max(content, type(time_step)(0.0)))
        water_out[row, column] = remaining
        taken += wp.float64(content) - wp.float64(remaining)
    transpired_out[row] += taken
