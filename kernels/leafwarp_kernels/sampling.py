"""Sampling a map at points of the leaf (paper, Sec. III-C: the fluid is read at the springs' midpoints).

A sample is the bilinear mean of the four cells around the point, taken over leaf cells only::

    y = sum_k w_k m_k y_k / sum_k w_k m_k

with ``m_k`` = 1 on the leaf and 0 off it. The points never move on the map, so cells and normalised weights are
tables made once. Written as ``y_0 + sum_k w_k (y_k - y_0)`` a constant field is sampled exactly.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def sample_map(
    # inputs:
    values: wp.array[wp.Float],
    stencil_cells: wp.array2d[wp.int32],
    stencil_weights: wp.array2d[wp.Float],
    # outputs:
    samples_out: wp.array[wp.Float],
):
    """Sample a map, flattened, at each point's stencil of four cells, shape [point_count, 4]."""
    point = wp.tid()
    reference = values[stencil_cells[point, 0]]
    sample = reference
    for k in range(1, 4):
        sample += stencil_weights[point, k] * (values[stencil_cells[point, k]] - reference)
    samples_out[point] = sample
