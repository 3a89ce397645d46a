"""Second derivatives of the hinges' energy ``k/2 (theta - theta0)^2`` (Tamstorf and Grinspun 2013, in other variables).

    H = k grad(theta) grad(theta)^T + k (theta - theta0) Hess(theta).

``Hess(theta)`` is a sum over the hinge's two triangles ("sides"). For the side with the edge ``e = b - a`` of length
``l``, the opposite vertex ``c`` at the height ``h`` over the foot ``a + s e``, the unit normal ``N``, and the unit
vectors ``e^`` along the edge and ``t`` from the edge to ``c``, a motion ``u`` of the vertices counts by

    u_e = u_b - u_a          (how the edge turns and grows),
    u_q = u_c - (1 - s) u_a - s u_b          (how c moves over its foot),

and the side's gradient is ``N.u_q / h``. As the normal turns by ``-(N.u_e) e^ / l - (N.u_q) t / h``, the height grows
by ``t.u_q`` and the foot goes by ``e^.u_q / l + h t.u_e / l^2``, the second derivative is, with ``x y`` the symmetric
product of two linear forms, ``x(u) y(v) + y(u) x(v)``,

    - N_e e^_q / (h l)  -  N_q t_q / h^2  -  N_e t_e / (2 l^2);

what is not symmetric of the last term is the opposite of the other side's.

It pairs forms out of the plane, ``N_e`` and ``N_q``, with forms in it, ``A = -e^_q / (h l) - t_e / (2 l^2)`` and
``B = -t_q / h^2``, and so has eigenvalues in pairs +-. With the Gram matrices ``U`` of the former and ``V`` of the
latter, the positive part of ``m`` times it is

    ( m Hess + |m| (N_e, N_q) X (N_e, N_q)^T + |m| (A, B) X^-1 (A, B)^T ) / 2,

where ``X U X = V``, so ``X`` is the geometric mean of ``U^-1`` and ``V``.
"""

import warp as wp

from leafwarp_kernels.dihedral import sides_and_normals
from leafwarp_kernels.hinge_potential import COLLAPSED

wp.set_module_options({"enable_backward": False})

# Blocks of a hinge's Hessian: which two of its vertices a, b, c, d each belongs to.
BLOCK_PAIRS = ((0, 0), (1, 1), (2, 2), (3, 3), (0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


@wp.struct
class Side:
    """One triangle of a hinge: what its second derivative is made of.

    Attributes:
        gradient: ``N / h``.
        foot: ``s``.
        edge_edge: Matrix between ``u_e`` and ``u_e``.
        edge_rise: Matrix between ``u_e`` and ``u_q``.
        rise_rise: Matrix between ``u_q`` and ``u_q``.
    """

    gradient: wp.vec3d
    foot: wp.float64
    edge_edge: wp.mat33d
    edge_rise: wp.mat33d
    rise_rise: wp.mat33d


@wp.func
def geometric_mean(a: wp.mat22d, b: wp.mat22d):
    """The symmetric ``X`` with ``X a^-1 X = b``, for symmetric positive definite matrices."""
    size_a = wp.sqrt(wp.determinant(a))
    size_b = wp.sqrt(wp.determinant(b))
    total = a / size_a + b / size_b
    return total * wp.sqrt(size_a * size_b / wp.determinant(total))


@wp.func
def side_of(
    edge: wp.vec3d,
    to_opposite: wp.vec3d,
    normal: wp.vec3d,
    moment: wp.float64,
    convex: wp.bool,
):
    """A side's gradient and the matrices of ``moment`` times its second derivative; its positive part if ``convex``.

    Args:
        edge: ``b - a``.
        to_opposite: ``c - a``.
        normal: Area normal, of the length ``l h``.
        moment: ``k (theta - theta0)``.
        convex: Whether to leave out what is not positive.
    """
    one = wp.float64(1.0)
    length = wp.max(wp.length(edge), wp.float64(1.0e-15))
    double_area = wp.max(wp.length(normal), COLLAPSED * length * length)
    height = double_area / length
    along = edge / length
    out = normal / double_area
    side = Side()
    side.foot = wp.dot(to_opposite, along) / length
    side.gradient = out / height
    rise = (to_opposite - along * (side.foot * length)) / height
    inverse = one / height
    pace = one / length
    turn_edge = wp.outer(out, rise)
    turn_edge = turn_edge + wp.transpose(turn_edge)
    edge_edge = turn_edge * (wp.float64(-0.5) * moment * pace * pace)
    edge_rise = wp.outer(out, along) * (-moment * inverse * pace)
    rise_rise = turn_edge * (-moment * inverse * inverse)
    if convex:
        weight = wp.float64(0.5) * wp.abs(moment)
        foot = side.foot
        square = one + foot * foot + (one - foot) * (one - foot)
        skew = one - wp.float64(2.0) * foot
        # U^-1, of the forms N_e and N_q.
        inverse_size = one / (wp.float64(2.0) * square - skew * skew)
        outside = wp.mat22d(square, -skew, -skew, wp.float64(2.0)) * inverse_size
        mixed = wp.float64(0.5) * skew * (pace * inverse) * (pace * inverse)
        inside = wp.mat22d(
            square * (pace * inverse) * (pace * inverse) + wp.float64(0.5) * pace * pace * pace * pace,
            mixed,
            mixed,
            square * inverse * inverse * inverse * inverse,
        )
        mean = geometric_mean(outside, inside)
        dual = wp.inverse(mean)
        upright = wp.outer(out, out)
        a_edge = rise * (wp.float64(-0.5) * pace * pace)
        a_rise = along * (-inverse * pace)
        b_rise = rise * (-inverse * inverse)
        half = wp.float64(0.5)
        edge_edge = edge_edge * half + (upright * mean[0, 0] + wp.outer(a_edge, a_edge) * dual[0, 0]) * weight
        to_rise = a_rise * dual[0, 0] + b_rise * dual[0, 1]
        edge_rise = edge_rise * half + (upright * mean[0, 1] + wp.outer(a_edge, to_rise)) * weight
        in_plane = wp.outer(a_rise, to_rise) + wp.outer(b_rise, a_rise * dual[0, 1] + b_rise * dual[1, 1])
        rise_rise = rise_rise * half + (upright * mean[1, 1] + in_plane) * weight
    side.edge_edge = edge_edge
    side.edge_rise = edge_rise
    side.rise_rise = rise_rise
    return side


@wp.func
def sides_of(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d, moment: wp.float64, convex: wp.bool):
    """The two sides of a hinge."""
    edge, side_c, side_d, normal_c, normal_d = sides_and_normals(a, b, c, d)
    first = side_of(edge, side_c, normal_c, moment, convex)
    second = side_of(edge, side_d, normal_d, moment, convex)
    return first, second


@wp.func
def side_product(
    out: wp.vec3d,
    rise: wp.vec3d,
    along: wp.vec3d,
    height: wp.float64,
    length: wp.float64,
    moment: wp.float64,
    turn: wp.vec3d,
    lift: wp.vec3d,
):
    """``moment`` times a side's second derivative times a motion with ``u_e = turn`` and ``u_q = lift``.

    Returns:
        What belongs to ``u_q`` and to ``u_e``.
    """
    by_height = moment / height
    by_length = moment / length
    turn_out = wp.dot(out, turn)
    lift_out = wp.dot(out, lift)
    out_of_lift = by_height * wp.dot(rise, lift) / height
    out_of_turn = wp.float64(0.5) * by_length * wp.dot(rise, turn) / length
    on_lift = -out * out_of_lift - rise * (by_height * lift_out / height) - along * (by_height * turn_out / length)
    on_turn = -out * (by_height * wp.dot(along, lift) / length + out_of_turn)
    on_turn -= rise * (wp.float64(0.5) * by_length * turn_out / length)
    return on_lift, on_turn


@wp.kernel
def hinge_products(
    # inputs:
    position: wp.array[wp.vec3d],
    direction: wp.array[wp.vec3d],
    hinge_vertices: wp.array2d[wp.int32],
    hinge_base_angle: wp.array[wp.float64],
    hinge_target_angle: wp.array[wp.float64],
    hinge_strength: wp.array[wp.float64],
    # outputs:
    hinge_product_out: wp.array[wp.vec3d],
):
    """Hessian of each hinge times a direction, at its four vertices."""
    hinge = wp.tid()
    i = hinge_vertices[hinge, 0]
    j = hinge_vertices[hinge, 1]
    k = hinge_vertices[hinge, 2]
    m = hinge_vertices[hinge, 3]
    strength = hinge_strength[hinge]
    moment = strength * (hinge_base_angle[hinge] - hinge_target_angle[hinge])
    edge, side_c, side_d, normal_c, normal_d = sides_and_normals(position[i], position[j], position[k], position[m])
    length = wp.max(wp.length(edge), wp.float64(1.0e-15))
    along = edge / length
    floor = COLLAPSED * length * length
    area_c = wp.max(wp.length(normal_c), floor)
    area_d = wp.max(wp.length(normal_d), floor)
    height_c = area_c / length
    height_d = area_d / length
    out_c = normal_c / area_c
    out_d = normal_d / area_d
    share_c = wp.dot(side_c, along)
    share_d = wp.dot(side_d, along)
    rise_c = (side_c - along * share_c) / height_c
    rise_d = (side_d - along * share_d) / height_d
    foot_c = share_c / length
    foot_d = share_d / length
    base = direction[i]
    turn = direction[j] - base
    lift_c = direction[k] - base - foot_c * turn
    lift_d = direction[m] - base - foot_d * turn
    rate = strength * (wp.dot(out_c, lift_c) / height_c + wp.dot(out_d, lift_d) / height_d)
    on_c, turn_c = side_product(out_c, rise_c, along, height_c, length, moment, turn, lift_c)
    on_d, turn_d = side_product(out_d, rise_d, along, height_d, length, moment, turn, lift_d)
    on_c += out_c * (rate / height_c)
    on_d += out_d * (rate / height_d)
    on_b = turn_c + turn_d - foot_c * on_c - foot_d * on_d
    hinge_product_out[4 * hinge] = -(on_b + on_c + on_d)
    hinge_product_out[4 * hinge + 1] = on_b
    hinge_product_out[4 * hinge + 2] = on_c
    hinge_product_out[4 * hinge + 3] = on_d


@wp.kernel
def add_hinge_products(
    # inputs:
    vertex_hinge_start: wp.array[wp.int32],
    vertex_hinge_slots: wp.array[wp.int32],
    hinge_product: wp.array[wp.vec3d],
    pinned: wp.array[wp.bool],
    # in and out:
    product: wp.array[wp.vec3d],
):
    """Add the hinges' products at each vertex that is not held, in a fixed order."""
    vertex = wp.tid()
    if pinned[vertex]:
        return
    total = product[vertex]
    for k in range(vertex_hinge_start[vertex], vertex_hinge_start[vertex + 1]):
        total += hinge_product[vertex_hinge_slots[k]]
    product[vertex] = total


@wp.func
def put_block(blocks: wp.array2d[wp.vec3d], block: wp.int32, matrix: wp.mat33d):
    """Store the rows of a block."""
    for row in range(3):
        blocks[block, row] = matrix[row]


@wp.kernel
def hinge_blocks(
    # inputs:
    position: wp.array[wp.vec3d],
    hinge_vertices: wp.array2d[wp.int32],
    hinge_base_angle: wp.array[wp.float64],
    hinge_target_angle: wp.array[wp.float64],
    hinge_strength: wp.array[wp.float64],
    convex: wp.bool,
    # outputs:
    hinge_block_out: wp.array2d[wp.vec3d],
):
    """Rows of the ten blocks of each hinge's Hessian in the order of ``BLOCK_PAIRS``, shape [10 * hinge_count, 3]."""
    hinge = wp.tid()
    a = position[hinge_vertices[hinge, 0]]
    b = position[hinge_vertices[hinge, 1]]
    c = position[hinge_vertices[hinge, 2]]
    d = position[hinge_vertices[hinge, 3]]
    strength = hinge_strength[hinge]
    moment = strength * (hinge_base_angle[hinge] - hinge_target_angle[hinge])
    first, second = sides_of(a, b, c, d, moment, convex)
    # Rows and columns of u_e and the two u_q, the product of the gradients included.
    cc = first.rise_rise + wp.outer(first.gradient, first.gradient) * strength
    dd = second.rise_rise + wp.outer(second.gradient, second.gradient) * strength
    cd = wp.outer(first.gradient, second.gradient) * strength
    ec = first.edge_rise
    ed = second.edge_rise
    # From them, those of b, c and d: u_b is in u_e once and in each u_q minus s times.
    bc = ec - cc * first.foot - wp.transpose(cd) * second.foot
    bd = ed - cd * first.foot - dd * second.foot
    bb = first.edge_edge + second.edge_edge
    bb = bb - ec * first.foot - ed * second.foot
    bb = bb - wp.transpose(bc) * first.foot - wp.transpose(bd) * second.foot
    # The same for all four moves nothing.
    ab = -(bb + wp.transpose(bc) + wp.transpose(bd))
    ac = -(bc + cc + wp.transpose(cd))
    ad = -(bd + cd + dd)
    aa = -(ab + ac + ad)
    start = 10 * hinge
    put_block(hinge_block_out, start, aa)
    put_block(hinge_block_out, start + 1, bb)
    put_block(hinge_block_out, start + 2, cc)
    put_block(hinge_block_out, start + 3, dd)
    put_block(hinge_block_out, start + 4, ab)
    put_block(hinge_block_out, start + 5, ac)
    put_block(hinge_block_out, start + 6, ad)
    put_block(hinge_block_out, start + 7, bc)
    put_block(hinge_block_out, start + 8, bd)
    put_block(hinge_block_out, start + 9, cd)


@wp.kernel
def add_hinge_blocks(
    # inputs:
    block_hinge_start: wp.array[wp.int32],
    block_hinge_slots: wp.array[wp.int32],
    hinge_block: wp.array2d[wp.vec3d],
    # in and out:
    block: wp.array2d[wp.vec3d],
):
    """Add the hinges' blocks. Slot ``2 k`` is block ``k`` of the hinges, slot ``2 k + 1`` its transpose."""
    index = wp.tid()
    total = wp.matrix_from_rows(block[index, 0], block[index, 1], block[index, 2])
    for k in range(block_hinge_start[index], block_hinge_start[index + 1]):
        slot = block_hinge_slots[k]
        place = slot / 2
        part = wp.matrix_from_rows(hinge_block[place, 0], hinge_block[place, 1], hinge_block[place, 2])
        if slot % 2 == 1:
            part = wp.transpose(part)
        total += part
    for row in range(3):
        block[index, row] = total[row]
