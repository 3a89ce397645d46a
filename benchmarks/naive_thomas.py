"""Thomas' algorithm as a tutorial writes it, one line a thread: a contender of the fluid benchmark.

The pivots are found anew in every step, and the textbook's difference ``b - a c'`` in them loses accuracy as beta
grows.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def naive_lines(
    # inputs:
    conductance: wp.array2d[wp.float32],
    span: wp.array2d[wp.int32],
    time_step: wp.float32,
    # scratch:
    upper: wp.array2d[wp.float32],
    # in and out:
    content: wp.array2d[wp.float32],
):
    """One implicit step along each line."""
    line = wp.tid()
    first = span[line, 0]
    end = span[line, 1]
    for cell in range(first, end):
        before = wp.float32(0.0)
        if cell > first:
            before = conductance[line, cell - 1] * time_step
        after = conductance[line, cell] * time_step
        pivot = 1.0 + before + after
        value = content[line, cell]
        if cell > first:
            pivot += before * upper[line, cell - 1]
            value += before * content[line, cell - 1]
        upper[line, cell] = -after / pivot
        content[line, cell] = value / pivot
    for back in range(1, end - first):
        cell = end - 1 - back
        content[line, cell] = content[line, cell] - upper[line, cell] * content[line, cell + 1]
