"""Water that enters at the petiole base.

Each source cell exchanges water with a supply through its share of the total conductance G,

    dy/dt = G w N (y_supply - y),

with the weights w of sum 1 and N the number of leaf cells, so that the leaf's mean content rises by
``G sum w (y_supply - y)`` a second whatever the map's size. Over a step the exact solution is
``y += (y_supply - y) (1 - exp(-G w N dt))``, which never passes the supply. Water does not flow back.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def supply_water(
    # inputs:
    source_cell: wp.array2d[wp.int32],
    source_rate: wp.array[wp.float64],
    supply: wp.Float,
    time_step: wp.float64,
    # outputs:
    water_out: wp.array2d[wp.Float],
    added_out: wp.array[wp.float64],
):
    """Add what enters each source cell in a step.

    Args:
        source_cell: Row and column of each source cell, shape [source_count, 2].
        source_rate: ``G w N`` of each [1/s], shape [source_count].
        supply: Relative water content of the supply.
        time_step: Time for which the source is open [s].
        water_out: Relative water content, shape [ny, nx]; changed at the source cells.
        added_out: Sum of the contents added to each source cell so far, shape [source_count]; added to.
    """
    source = wp.tid()
    row = source_cell[source, 0]
    column = source_cell[source, 1]
    content = water_out[row, column]
    if content < supply:
        share = wp.float64(1.0) - wp.exp(-source_rate[source] * time_step)
        filled = wp.min(content + type(supply)(share * wp.float64(supply - content)), supply)
        water_out[row, column] = filled
        added_out[source] += wp.float64(filled) - wp.float64(content)
