"""How the structure follows the water: a spring's parameter as a function of the relative water content y there.

With a response curve ``f``, piecewise linear in y and constant beyond its ends, every parameter is one of::

    p = p_start + gain (f(y) - f(y_start))      rest length: gain = -l_start (1 - resist venation), f = shrink
                                                rest angle:  gain = 1.5 d / h (1 - resist venation), f = mismatch
                                                mass:        gain = W A, f(y) = y
    p = gain f(y)                               stiffness:   gain = k_start (1 + (vein - 1) venation)

``d`` is the hinge's span, ``h`` the thickness: two equal layers with a strain mismatch e bend to 1.5 e / h
(Timoshenko). The photo is the unstressed shape, so a rest length or angle sees the change of its curve alone.

With a plastic set ``s`` that change ``c`` keeps a share of the largest that it has ever had, ``c_peak``::

    p = p_start + gain ((1 - s) c + s c_peak).
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def response(water: Any, knots: wp.array[Any], values: wp.array[Any]):
    """Value at ``water`` of the curve through (knots, values), knots rising."""
    last = knots.shape[0] - 1
    result = values[0]
    if water >= knots[last]:
        result = values[last]
    else:
        for k in range(last):
            if water >= knots[k] and water < knots[k + 1]:
                share = (water - knots[k]) / (knots[k + 1] - knots[k])
                result = values[k] + share * (values[k + 1] - values[k])
    return result


@wp.kernel
def respond_to_change(
    # inputs:
    water: wp.array[wp.Float],
    knots: wp.array[wp.Float],
    values: wp.array[wp.Float],
    response_start: wp.array[wp.Float],
    gain: wp.array[wp.Float],
    parameter_start: wp.array[wp.Float],
    # outputs:
    parameter_out: wp.array[wp.Float],
):
    """Parameter that follows the change of its response since the start; exactly its start value where none."""
    i = wp.tid()
    change = response(water[i], knots, values) - response_start[i]
    parameter_out[i] = parameter_start[i] + gain[i] * change


@wp.kernel
def respond_with_set(
    # inputs:
    water: wp.array[wp.Float],
    knots: wp.array[wp.Float],
    values: wp.array[wp.Float],
    response_start: wp.array[wp.Float],
    gain: wp.array[wp.Float],
    parameter_start: wp.array[wp.Float],
    plastic_set: wp.Float,
    # outputs:
    peak_out: wp.array[wp.Float],
    parameter_out: wp.array[wp.Float],
):
    """The same with a plastic set; ``peak_out`` remembers the largest change from call to call.

    Where the change is its own peak, the parameter is bit by bit that of :func:`respond_to_change`.
    """
    i = wp.tid()
    change = response(water[i], knots, values) - response_start[i]
    peak = peak_out[i]
    if wp.abs(change) > wp.abs(peak):
        peak = change
    peak_out[i] = peak
    parameter_out[i] = parameter_start[i] + gain[i] * (change + plastic_set * (peak - change))


@wp.kernel
def respond_in_proportion(
    # inputs:
    water: wp.array[wp.Float],
    knots: wp.array[wp.Float],
    values: wp.array[wp.Float],
    gain: wp.array[wp.Float],
    # outputs:
    parameter_out: wp.array[wp.Float],
):
    """Parameter in proportion to its response."""
    i = wp.tid()
    parameter_out[i] = gain[i] * response(water[i], knots, values)
