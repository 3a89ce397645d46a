"""Water lost through the surface of the leaf.

In a step dt each cell loses ``min(y, (cuticle + stomatal) dt)``: a sink never takes more than is there.

Where the stomata close as the leaf dries, with an opening ``f(y)`` that is piecewise linear,

    dy/dt = -r(y),      r(y) = cuticle + stomatal f(y),

has an exact solution from knot to knot. In a piece that ends at the knot ``b``, with ``m = (r(y) - r(b)) / (y - b)``,

    y(t) = y - r(y) (1 - exp(-m t)) / m,      and b is reached at      t_b = ln(r(y) / r(b)) / m,

never if ``r(b) = 0``. A step follows it through as many pieces as it takes, so that the loss is that of the
differential equation for any step: an explicit one would overshoot the point where the stomata close.

One thread takes a segment of a row of the map (on a CPU the whole row) and adds up in float64 what really left the
stored contents, so that the ledger closes.
"""

import warp as wp

from leafwarp_kernels.lanes import LANES, Lanes
from leafwarp_kernels.response import response

wp.set_module_options({"enable_backward": False})

TakenLanes = wp.types.vector(LANES, wp.float64)


@wp.kernel
def transpire(
    # inputs:
    cuticle_rate: wp.Float,
    stomatal_rate: wp.array2d[wp.Float],
    time_step: wp.Float,
    segment_length: wp.int32,
    # outputs:
    water_out: wp.array2d[wp.Float],
    transpired_out: wp.array2d[wp.float64],
):
    """Take what transpires in a step through stomata that stay open.

    Args:
        cuticle_rate: Loss everywhere alike [1/s].
        stomatal_rate: Further loss of each cell [1/s], shape [ny, nx]; None for none.
        time_step: [s].
        segment_length: Cells of a thread.
        water_out: Relative water content, shape [ny, nx]; cells off the leaf hold 0 and keep it.
        transpired_out: Sum of the contents taken from each segment so far, shape [segment, ny]; added to.
    """
    segment, row = wp.tid()
    taken = wp.float64(0.0)
    for column in range(segment * segment_length, wp.min((segment + 1) * segment_length, water_out.shape[1])):
        content = water_out[row, column]
        loss = cuticle_rate * time_step
        if stomatal_rate:
            loss += stomatal_rate[row, column] * time_step
        remaining = content - wp.min(loss, wp.max(content, type(time_step)(0.0)))
        water_out[row, column] = remaining
        taken += wp.float64(content) - wp.float64(remaining)
    transpired_out[segment, row] += taken


@wp.kernel
def transpire_lanes(
    # inputs:
    cuticle_rate: wp.Float,
    stomatal_rate: wp.array2d[Lanes],
    span: wp.array2d[wp.int32],
    time_step: wp.Float,
    # outputs:
    water_out: wp.array2d[Lanes],
    transpired_out: wp.array2d[wp.float64],
):
    """:func:`transpire` for a CPU, a block of cells at a time.

    Args:
        cuticle_rate: Loss everywhere alike [1/s].
        stomatal_rate: Further loss of each cell [1/s], shape [ny, block]; None for none.
        span: First block of each row with a leaf cell and the one after its last, shape [ny, 2].
        time_step: [s].
        water_out: Relative water content, shape [ny, block]; cells off the leaf hold 0 and keep it.
        transpired_out: Sum of the contents taken from each row so far, shape [1, ny]; added to.
    """
    row = wp.tid()
    none = water_out.dtype()
    cuticular = water_out.dtype(cuticle_rate * time_step)
    taken = TakenLanes()
    for block in range(span[row, 0], span[row, 1]):
        content = water_out[row, block]
        loss = cuticular
        if stomatal_rate:
            loss += stomatal_rate[row, block] * time_step
        remaining = content - wp.min(loss, wp.max(content, none))
        water_out[row, block] = remaining
        for lane in range(LANES):
            taken[lane] += wp.float64(content[lane]) - wp.float64(remaining[lane])
    total = wp.float64(0.0)
    for lane in range(LANES):
        total += taken[lane]
    transpired_out[0, row] += total


@wp.func
def time_to_bottom(height: wp.float64, rate: wp.float64, bottom_rate: wp.float64):
    """Time in which a content falls by ``height`` while its rate goes linearly to ``bottom_rate``, both above 0 [s]."""
    total = rate + bottom_rate
    z = (rate - bottom_rate) / total
    # ln(r / b) / (r - b) = 2 artanh(z) / (z (r + b)); near z = 0 by its series, where the logarithm loses digits.
    mean = wp.float64(0.0)
    if wp.abs(z) < wp.float64(0.05):
        power = wp.float64(1.0)
        for n in range(6):
            mean += power / wp.float64(2 * n + 1)
            power *= z * z
        mean *= wp.float64(2.0) / total
    else:
        mean = wp.log(rate / bottom_rate) / (rate - bottom_rate)
    return height * mean


@wp.func
def fall(height: wp.float64, rate: wp.float64, bottom_rate: wp.float64, seconds: wp.float64):
    """What a content loses in a time too short to reach the bottom of its piece, ``height`` below it."""
    change = rate - bottom_rate
    x = seconds * change / height
    if wp.abs(x) < wp.float64(0.1):
        # (1 - exp(-x)) / x by its series 1 - x / 2 (1 - x / 3 (...)), where the difference loses digits.
        share = wp.float64(1.0)
        for n in range(9):
            share = wp.float64(1.0) - x * share * wp.float64(wp.static(1.0 / (10 - n)))
        return rate * seconds * share
    return height * (rate / change) * (wp.float64(1.0) - wp.exp(-x))


@wp.func
def content_after(
    content: wp.float64,
    cuticle_rate: wp.float64,
    stomatal_rate: wp.float64,
    time_step: wp.float64,
    knots: wp.array[wp.float64],
    openings: wp.array[wp.float64],
):
    """Content after a step of ``dy/dt = -(cuticle + stomatal f(y))``, f through (knots, openings); 0 at the least."""
    last = knots.shape[0] - 1
    left = time_step
    now = content
    rate = cuticle_rate + stomatal_rate * response(content, knots, openings)
    # Piece by piece from above: its bottom is knot "last" down to knot 0, and then 0.
    for piece in range(last + 2):
        knot = wp.max(last - piece, 0)
        bottom = wp.where(piece <= last, knots[knot], wp.float64(0.0))
        if now > bottom:
            bottom_rate = cuticle_rate + stomatal_rate * openings[knot]
            height = now - bottom
            until_bottom = wp.float64(wp.inf)
            may_reach = wp.max(rate, bottom_rate) * left >= height
            if may_reach and rate > wp.float64(0.0) and bottom_rate > wp.float64(0.0):
                until_bottom = time_to_bottom(height, rate, bottom_rate)
            if until_bottom > left:
                if rate > wp.float64(0.0):
                    now -= wp.clamp(fall(height, rate, bottom_rate, left), wp.float64(0.0), height)
                break
            left -= until_bottom
            now = bottom
            rate = bottom_rate
    return now


@wp.kernel
def transpire_with_closure(
    # inputs:
    cuticle_rate: wp.float64,
    stomatal_rate: wp.array2d[wp.Float],
    knots: wp.array[wp.float64],
    openings: wp.array[wp.float64],
    time_step: wp.float64,
    segment_length: wp.int32,
    # outputs:
    water_out: wp.array2d[wp.Float],
    transpired_out: wp.array2d[wp.float64],
):
    """Take what transpires in a step through stomata that close as the leaf dries.

    Args:
        cuticle_rate: Loss everywhere alike [1/s].
        stomatal_rate: Further loss of each cell with open stomata [1/s], shape [ny, nx].
        knots: Relative water contents of the response curve of the opening, rising, shape [knot_count].
        openings: Opening of the stomata there, 0 to 1, shape [knot_count].
        time_step: [s].
        segment_length: Cells of a thread.
        water_out: Relative water content, shape [ny, nx]; cells off the leaf hold 0 and keep it.
        transpired_out: Sum of the contents taken from each segment so far, shape [segment, ny]; added to.
    """
    segment, row = wp.tid()
    taken = wp.float64(0.0)
    for column in range(segment * segment_length, wp.min((segment + 1) * segment_length, water_out.shape[1])):
        stored = water_out[row, column]
        content = wp.float64(stored)
        if content > wp.float64(0.0):
            stomatal = wp.float64(stomatal_rate[row, column])
            after = content_after(content, cuticle_rate, stomatal, time_step, knots, openings)
            remaining = type(stored)(after)
            water_out[row, column] = remaining
            taken += content - wp.float64(remaining)
    transpired_out[segment, row] += taken
