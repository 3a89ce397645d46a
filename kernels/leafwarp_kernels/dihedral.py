"""The dihedral angle of two triangles that share an edge, and its gradient.

A hinge is four vertices: the edge ``a -> b`` in the direction that it has in its first triangle ``(a, b,
c)``, and ``d``, opposite in the second triangle ``(b, a, d)``. With ``e = b - a`` and the triangles' area
normals ``n1 = e x (c - a)``, ``n2 = (d - a) x e``,

    theta = atan2(|e| (c - a).n2, n1.n2),        in (-pi, pi], 0 where flat, continuous through flat,

positive where ``c`` and ``d`` are folded toward the normals. Its gradient (Bridson et al. 2003; Grinspun et
al. 2003) is ``g_c = |e| n1 / |n1|^2``, ``g_d = |e| n2 / |n2|^2`` on the opposite vertices, and on the edge's
own vertices what keeps linear and angular momentum: with ``s`` and ``t`` the feet of ``c`` and ``d`` on the
edge, as shares from a,

    g_b = -(s g_c + t g_d),                      g_a = -(g_c + g_d) - g_b.
"""

from typing import Any

import warp as wp

from leafwarp_kernels.lanes import LANES, lane_cross, lane_dot, lane_scaled

# Square of the height, as a share of the edge, below which a triangle counts as collapsing. Triangles of a leaf's mesh
# are several times higher: 0.34 of the edge and more, on every scene shipped.
FADING = wp.constant(0.01)


@wp.func
def angle_between(sine: Any, cosine: Any):
    """``atan2(sine, cosine)``, by its series where the angle is small, as most are: several times faster there.

    Up to 1/8 the first term left out is below 3e-17 of the angle.
    """
    one = type(sine)(1.0)
    angle = sine
    if cosine > type(sine)(8.0) * wp.abs(sine):
        tangent = sine / cosine
        square = -tangent * tangent
        series = one / type(sine)(13.0) + square / type(sine)(15.0)
        series = one / type(sine)(11.0) + square * series
        series = one / type(sine)(9.0) + square * series
        series = one / type(sine)(7.0) + square * series
        series = one / type(sine)(5.0) + square * series
        series = one / type(sine)(3.0) + square * series
        angle = tangent + tangent * square * series
    else:
        angle = wp.atan2(sine, cosine)
    return angle


@wp.func
def sides_and_normals(a: Any, b: Any, c: Any, d: Any):
    """``e``, ``c - a`` and ``d - a``, and the area normals ``n1`` and ``n2``."""
    edge = b - a
    side_c = c - a
    side_d = d - a
    return edge, side_c, side_d, wp.cross(edge, side_c), wp.cross(side_d, edge)


@wp.func
def dihedral(a: Any, b: Any, c: Any, d: Any):
    """Angle, gradients at ``c`` and ``d``, and the feet of ``c`` and ``d`` on the edge as shares from ``a``.

    As a triangle collapses onto the edge its gradient grows without bound, and the angle jumps as it passes through.
    Below a height of a tenth of the edge (:data:`FADING`) both gradients fade to zero instead, by the same factor, so
    that momentum is still conserved.
    """
    edge, side_c, side_d, normal_c, normal_d = sides_and_normals(a, b, c, d)
    square = wp.dot(edge, edge)
    square_c = wp.dot(normal_c, normal_c)
    square_d = wp.dot(normal_d, normal_d)
    length = wp.sqrt(square)
    angle = angle_between(length * wp.dot(side_c, normal_d), wp.dot(normal_c, normal_d))
    floor = type(square)(FADING) * square * square + type(square)(1.0e-30)
    inverse_c = type(square)(1.0) / wp.max(square_c, floor)
    inverse_d = type(square)(1.0) / wp.max(square_d, floor)
    gradient_c = normal_c * (length * inverse_c * square_d * inverse_d)
    gradient_d = normal_d * (length * inverse_d * square_c * inverse_c)
    inverse_square = type(square)(1.0) / wp.max(square, type(square)(1.0e-30))
    foot_c = wp.dot(side_c, edge) * inverse_square
    foot_d = wp.dot(side_d, edge) * inverse_square
    return angle, gradient_c, gradient_d, foot_c, foot_d


@wp.func
def continued(angle: Any, before: Any):
    """The angle that equals ``angle`` up to whole turns and is nearest to ``before``.

    A fold that passes +-pi is so pulled back the way it came, instead of being thrown on round by a jump of 2
    pi.
    """
    turn = type(angle)(6.283185307179586)
    change = angle - before
    if type(angle)(2.0) * wp.abs(change) > turn:
        return angle - turn * wp.round(change / turn)
    return angle


@wp.func
def reachable(rest_angle: Any):
    """A rest angle within +-pi: two triangles that lie on each other cannot close any further."""
    half_turn = type(rest_angle)(3.141592653589793)
    return wp.clamp(rest_angle, -half_turn, half_turn)


@wp.func
def lane_angle_between(sine: Any, cosine: Any):
    """:func:`angle_between` in each lane."""
    tangent = wp.cw_div(sine, cosine)
    square = -wp.cw_mul(tangent, tangent)
    series = series_term(square, 13) + wp.cw_mul(square, series_term(square, 15))
    for term in range(5):
        series = series_term(square, 11 - 2 * term) + wp.cw_mul(square, series)
    angle = tangent + wp.cw_mul(wp.cw_mul(tangent, square), series)
    for lane in range(LANES):
        if not (cosine[lane] > type(sine[lane])(8.0) * wp.abs(sine[lane])):
            angle[lane] = wp.atan2(sine[lane], cosine[lane])
    return angle


@wp.func
def lane_dihedral(
    edge_x: Any, edge_y: Any, edge_z: Any, cx: Any, cy: Any, cz: Any, dx: Any, dy: Any, dz: Any, length: Any
):
    """:func:`dihedral` in each lane, from the edge, its length, and the ways from a to c and d."""
    one = type(length)(type(length[0])(1.0))
    tiny = type(length)(type(length[0])(1.0e-30))
    normal_cx, normal_cy, normal_cz = lane_cross(edge_x, edge_y, edge_z, cx, cy, cz)
    normal_dx, normal_dy, normal_dz = lane_cross(dx, dy, dz, edge_x, edge_y, edge_z)
    square = wp.cw_mul(length, length)
    square_c = lane_dot(normal_cx, normal_cy, normal_cz, normal_cx, normal_cy, normal_cz)
    square_d = lane_dot(normal_dx, normal_dy, normal_dz, normal_dx, normal_dy, normal_dz)
    sine = wp.cw_mul(length, lane_dot(cx, cy, cz, normal_dx, normal_dy, normal_dz))
    angle = lane_angle_between(sine, lane_dot(normal_cx, normal_cy, normal_cz, normal_dx, normal_dy, normal_dz))
    floor = wp.cw_mul(square, square) * type(length[0])(FADING) + tiny
    inverse_c = wp.cw_div(one, wp.max(square_c, floor))
    inverse_d = wp.cw_div(one, wp.max(square_d, floor))
    scale_c = wp.cw_mul(wp.cw_mul(length, inverse_c), wp.cw_mul(square_d, inverse_d))
    scale_d = wp.cw_mul(wp.cw_mul(length, inverse_d), wp.cw_mul(square_c, inverse_c))
    inverse_square = wp.cw_div(one, wp.max(square, tiny))
    foot_c = wp.cw_mul(lane_dot(cx, cy, cz, edge_x, edge_y, edge_z), inverse_square)
    foot_d = wp.cw_mul(lane_dot(dx, dy, dz, edge_x, edge_y, edge_z), inverse_square)
    normal_cx, normal_cy, normal_cz = lane_scaled(scale_c, normal_cx, normal_cy, normal_cz)
    normal_dx, normal_dy, normal_dz = lane_scaled(scale_d, normal_dx, normal_dy, normal_dz)
    return angle, normal_cx, normal_cy, normal_cz, normal_dx, normal_dy, normal_dz, foot_c, foot_d


@wp.func
def series_term(like: Any, odd: wp.int32):
    """``1 / odd`` in every lane."""
    return type(like)(type(like[0])(1.0) / type(like[0])(odd))


@wp.func
def lane_continued(angle: Any, before: Any):
    """:func:`continued` in each lane."""
    for lane in range(LANES):
        angle[lane] = continued(angle[lane], before[lane])
    return angle


@wp.func
def lane_reachable(rest_angle: Any):
    """:func:`reachable` in each lane."""
    half_turn = type(rest_angle)(type(rest_angle[0])(3.141592653589793))
    return wp.min(wp.max(rest_angle, -half_turn), half_turn)
