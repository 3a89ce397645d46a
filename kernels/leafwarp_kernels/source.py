"""Water exchanged with a supply at the petiole base.

Each source cell exchanges water with the supply through its share of the total conductance G,

    dy/dt = G w N (y_supply - y),

with the weights w of sum 1 and N the number of leaf cells, so that the leaf's mean content rises by
``G sum w (y_supply - y)`` a second whatever the map's size. A cell wetter than the supply gives water back.

What enters has to flow on within the same step, or a step could take in no more than the source cells hold. The
exchange is therefore part of the diffusion's implicit system: with ``S = G w N dt`` and the diffusion's matrix L,

    (I + S + L) y = f + S y_supply.

Written like this the contents would be lost in the rounding of S. Filling the source cells first, as if they were
alone, leaves a system whose right side is made of contents only:

    (E + L) y = E f',    E = I + S,    f' = f + (y_supply - f) S / (1 + S).

Its solution is a mean of the ``f'`` for any S, so it stays between the extremes of the contents and the supply.
What entered is counted as the difference that step and source together made to the stored contents, in float64:
``S (y_supply - y)`` would be a small difference times a large number.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def open_source(
    # inputs:
    source_cell: wp.array2d[wp.int32],
    source_rate: wp.array[wp.float64],
    open_for: wp.float64,
    # outputs:
    exchange_out: wp.array2d[wp.Float],
):
    """Set what each source cell exchanges in a step.

    Args:
        source_cell: Row and column of each source cell, shape [source_count, 2].
        source_rate: ``G w N`` of each [1/s], shape [source_count].
        open_for: Time for which the source is open [s]; 0 closes it.
        exchange_out: ``S``, shape [ny, nx]; written at the source cells, 0 at all others.
    """
    source = wp.tid()
    row = source_cell[source, 0]
    column = source_cell[source, 1]
    here = exchange_out[row, column]
    exchange_out[row, column] = type(here)(source_rate[source] * open_for)


@wp.kernel
def fill_lines(
    # inputs:
    exchange: wp.array2d[wp.Float],
    span: wp.array2d[wp.int32],
    segment_length: wp.int32,
    supply: wp.Float,
    # outputs:
    water_out: wp.array2d[wp.Float],
    added_out: wp.array2d[wp.float64],
):
    """Fill the source cells as if nothing flowed, and take what the line held before from its account.

    Args:
        exchange: ``S``, shape [line, cell].
        span: First cell to count of each line and the one after its last, shape [line, 2].
        segment_length: Cells of a thread.
        supply: Relative water content of the supply.
        water_out: Relative water content, shape [line, cell]; changed at the source cells.
        added_out: Content added to each line so far, by segments, shape [segment, line]; reduced by what it held.
    """
    segment, line = wp.tid()
    held = wp.float64(0.0)
    first = wp.max(span[line, 0], segment * segment_length)
    for cell in range(first, wp.min(span[line, 1], (segment + 1) * segment_length)):
        content = water_out[line, cell]
        held += wp.float64(content)
        strength = wp.float64(exchange[line, cell])
        if strength > wp.float64(0.0):
            share = strength / (wp.float64(1.0) + strength)
            filled = wp.float64(content) + share * (wp.float64(supply) - wp.float64(content))
            water_out[line, cell] = wp.clamp(type(supply)(filled), wp.min(content, supply), wp.max(content, supply))
    added_out[segment, line] -= held


@wp.kernel
def count_lines(
    # inputs:
    water: wp.array2d[wp.Float],
    span: wp.array2d[wp.int32],
    segment_length: wp.int32,
    # outputs:
    added_out: wp.array2d[wp.float64],
):
    """Add what each line holds to its account, after :func:`fill_lines` and a solve.

    Args:
        water: Relative water content, shape [line, cell].
        span: First cell to count of each line and the one after its last, shape [line, 2].
        segment_length: Cells of a thread.
        added_out: Content added to each line so far, by segments, shape [segment, line]; added to.
    """
    segment, line = wp.tid()
    held = wp.float64(0.0)
    first = wp.max(span[line, 0], segment * segment_length)
    for cell in range(first, wp.min(span[line, 1], (segment + 1) * segment_length)):
        held += wp.float64(water[line, cell])
    added_out[segment, line] += held
