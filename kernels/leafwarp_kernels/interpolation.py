"""The water at a moment between two fluid steps, and signs of what the host has to know of it.

The means of a line solve never leave the range of the contents that they are made of, and so lose sight of one that is
not a number. The accounts of what enters and leaves do not: once one of them is not a number, it stays so.
"""

import warp as wp

from leafwarp_kernels.lanes import LANES, Lanes

wp.set_module_options({"enable_backward": False})

# Slots of the signs: each holds the number of the last look at which it was seen.
WRONG = wp.constant(0)
CHANGED = wp.constant(1)
SIGN_COUNT = 2


@wp.func
def count_not_finite(account: wp.array2d[wp.float64], row: wp.int32):
    """Segments of a row whose account is not a finite number; 0 for a row that has none."""
    count = wp.int32(0)
    if row < account.shape[1]:
        for segment in range(account.shape[0]):
            count += wp.int32(not wp.isfinite(account[segment, row]))
    return count


@wp.kernel
def interpolate_water(
    # inputs:
    water_before: wp.array2d[Lanes],
    water: wp.array2d[Lanes],
    share: wp.Float,
    least: wp.Float,
    most: wp.Float,
    transpired: wp.array2d[wp.float64],
    added: wp.array2d[wp.float64],
    look: wp.int32,
    # outputs:
    water_now_out: wp.array2d[Lanes],
    sign_out: wp.array[wp.int32],
):
    """Blend linearly from the start of the last fluid step to its end; exact at the end, and where nothing changes.

    Args:
        water_before: Relative water content before the last step, shape [row, block].
        water: After it.
        share: Part of the step that has passed, in (0, 1].
        least: The blend is nowhere below this ...
        most: ... or above this.
        transpired: Account of what has left each row, by segments, shape [segment, row]; None for none.
        added: Account of what has entered each row, likewise.
        look: Number of this look, greater than that of the one before.
        water_now_out: The blend.
        sign_out: Set to ``look`` at :data:`WRONG` where the blend is out of its bounds, or it or an account is not a
            finite number, and at :data:`CHANGED` where the step has changed the content, shape [SIGN_COUNT].
    """
    row, block = wp.tid()
    before = water_before[row, block]
    after = water[row, block]
    now = after
    if share != type(share)(1.0):
        now = before + share * (after - before)
    water_now_out[row, block] = now
    outside = wp.int32(0)
    for lane in range(LANES):
        outside += wp.int32(not (now[lane] >= least and now[lane] <= most))
    if block == 0:
        if transpired:
            outside += count_not_finite(transpired, row)
        if added:
            outside += count_not_finite(added, row)
    if outside > 0:
        sign_out[WRONG] = look
    # The first block that has changed speaks for all.
    if sign_out[CHANGED] != look:
        if not (before == after):
            sign_out[CHANGED] = look
