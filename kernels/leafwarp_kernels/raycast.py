"""Pictures of a leaf by casting rays at its triangle mesh.

A thin surface seen from both sides stands over a matt ground. With albedo ``a``, unit normal
``n`` towards the viewer and unit vector ``l`` towards the light, the light that leaves a point is

    a [ key V max(n.l, 0) + ambient(n) S ] + key V (t T max(-n.l, 0) + gloss max(n.h, 0)^48),

where ``V`` is the visible part of the light's disc, ``S`` the visible part of the sky on the viewer's side,
``ambient(n) = mix(bounce, sky, (1 + n_z) / 2)`` the light of a hemisphere, ``t`` the albedo of light that has passed
through the blade, ``T`` the transmitted part, and ``h`` the half vector of Blinn (1977). All colours are linear RGB;
only the last kernel encodes them as sRGB.

``V`` and ``S`` cost several rays. They are smooth, so they are found at the vertices and, for the shadow on the
ground, on a grid; pixels interpolate them. A pixel costs one ray; only where the distance jumps between neighbours,
at an outline or a fold, more rays are cast. The jitter is a hash of a fixed seed and an index, so a picture is the
same, bit for bit, from run to run. Rays of sight pass the holes of the texture; those of the light do not, so a hole's
shadow is that of the whole leaf.

Rendering has one precision, float32.
"""

import warp as wp

# Loops of rays unrolled and inlined in each other cost seconds to compile and gain nothing.
wp.set_module_options({"enable_backward": False, "max_unroll": 1, "cpu_compiler_flags": "-march=native"})

LIGHT_RAYS = wp.constant(10)
SKY_RAYS = wp.constant(9)
GOLDEN_ANGLE = wp.constant(2.3999632)
FAR = wp.constant(1.0e30)
HALF_OPAQUE = wp.constant(0.5)
LAYERS = wp.constant(8)  # of a folded leaf that a ray looks through by way of holes
GLOSS_EXPONENT = wp.constant(48.0)
# Light that has passed through a leaf is yellower.
SHINE_TINT = wp.constant(wp.vec3(1.15, 1.1, 0.5))
BACK_GREY = wp.constant(0.45)
BACK_GAIN = wp.constant(1.1)
BACK_LIFT = wp.constant(wp.vec3(0.05, 0.055, 0.045))


@wp.struct
class Camera:
    """A pinhole camera; ``right`` and ``up`` span half the picture at unit distance along ``forward``."""

    position: wp.vec3
    forward: wp.vec3
    right: wp.vec3
    up: wp.vec3
    jump: wp.float32  # difference of distance between neighbouring pixels that counts as an outline [m]


@wp.struct
class Lighting:
    """A round key light at infinity and a sky; the strengths are such that the ground in full light gets 1."""

    to_light: wp.vec3
    disc_radius: wp.float32  # tangent of the light's angular radius
    key: wp.float32
    sky: wp.float32
    bounce: wp.float32
    gloss: wp.float32
    transmission: wp.float32
    offset: wp.float32  # distance from the surface at which shadow rays start [m]
    reach: wp.float32  # length of the rays that look for the sky [m]


@wp.struct
class Ground:
    """The horizontal plane ``z = height`` and where the grid of its shadow lies."""

    height: wp.float32
    corner: wp.vec2
    cell: wp.vec2
    color: wp.vec3
    shadow_depth: wp.float32  # how much of the ground's colour a full shadow takes


@wp.struct
class Surface:
    """The leaf: its mesh, what is known at the vertices, and its texture (colour and opacity, top row first)."""

    mesh: wp.uint64
    uv: wp.array[wp.vec2]
    normals: wp.array[wp.vec3]
    tint: wp.array[wp.vec4]  # a colour and how much of it; empty: no tint
    light_visible: wp.array[wp.float32]
    sky_visible: wp.array[wp.vec2]  # on the photographed side, on the back
    texture: wp.array2d[wp.vec4]
    brightness: wp.float32  # mean luminance of the texture on the leaf
    has_holes: wp.bool  # whether the texture is cut out anywhere


@wp.func
def across(axis: wp.vec3):
    """A unit vector at right angles to a unit vector."""
    helper = wp.vec3(1.0, 0.0, 0.0)
    if wp.abs(axis[0]) > 0.7:
        helper = wp.vec3(0.0, 1.0, 0.0)
    return wp.normalize(wp.cross(axis, helper))


@wp.func
def disc_point(ray: wp.int32, count: wp.int32, turn: wp.float32):
    """Point of a sunflower pattern on the unit disc (Vogel 1979), turned by an angle."""
    radius = wp.sqrt((float(ray) + 0.5) / float(count))
    angle = float(ray) * GOLDEN_ANGLE + turn
    return wp.vec2(radius * wp.cos(angle), radius * wp.sin(angle))


@wp.func
def light_visibility(mesh: wp.uint64, start: wp.vec3, lighting: Lighting, turn: wp.float32):
    """Part of the light's disc that is seen from a point."""
    side = across(lighting.to_light)
    other = wp.cross(lighting.to_light, side)
    seen = wp.float32(0.0)
    for ray in range(LIGHT_RAYS):
        point = lighting.disc_radius * disc_point(ray, LIGHT_RAYS, turn)
        direction = wp.normalize(lighting.to_light + point[0] * side + point[1] * other)
        if not wp.mesh_query_ray_anyhit(mesh, start, direction, FAR):
            seen += 1.0
    return seen / float(LIGHT_RAYS)


@wp.func
def sky_visibility(mesh: wp.uint64, start: wp.vec3, normal: wp.vec3, reach: wp.float32, turn: wp.float32):
    """Part of the hemisphere over a point that is free within reach, weighted by the cosine."""
    side = across(normal)
    other = wp.cross(normal, side)
    seen = wp.float32(0.0)
    for ray in range(SKY_RAYS):
        point = disc_point(ray, SKY_RAYS, turn)
        height = wp.sqrt(wp.max(1.0 - wp.length_sq(point), 0.0))
        if not wp.mesh_query_ray_anyhit(mesh, start, point[0] * side + point[1] * other + height * normal, reach):
            seen += 1.0
    return seen / float(SKY_RAYS)


@wp.kernel
def light_vertices(
    # inputs:
    surface: Surface,
    points: wp.array[wp.vec3],
    lighting: Lighting,
    # outputs:
    light_visible_out: wp.array[wp.float32],
    sky_visible_out: wp.array[wp.vec2],
):
    """Visible part of the light and, on both sides, of the sky at each vertex."""
    vertex = wp.tid()
    # The same directions everywhere: neighbours then differ by what they see, not by chance.
    turn = wp.float32(0.0)
    normal = surface.normals[vertex]
    front = points[vertex] + lighting.offset * normal
    back = points[vertex] - lighting.offset * normal
    lit = front
    if wp.dot(normal, lighting.to_light) < 0.0:
        lit = back
    light_visible_out[vertex] = light_visibility(surface.mesh, lit, lighting, turn)
    sky_visible_out[vertex] = wp.vec2(
        sky_visibility(surface.mesh, front, normal, lighting.reach, turn),
        sky_visibility(surface.mesh, back, -normal, lighting.reach, turn),
    )


@wp.kernel
def shade_ground(
    # inputs:
    mesh: wp.uint64,
    lighting: Lighting,
    ground: Ground,
    # outputs:
    visible_out: wp.array2d[wp.float32],
):
    """Part of the light that reaches each cell of the ground."""
    row, column = wp.tid()
    random = wp.rand_init(23, row * visible_out.shape[1] + column)
    turn = wp.randf(random) * wp.TAU
    start = wp.vec3(
        ground.corner[0] + (float(column) + 0.5) * ground.cell[0],
        ground.corner[1] + (float(row) + 0.5) * ground.cell[1],
        ground.height,
    )
    key = lighting.key * lighting.to_light[2] * light_visibility(mesh, start, lighting, turn)
    sky = lighting.sky * sky_visibility(mesh, start, wp.vec3(0.0, 0.0, 1.0), lighting.reach, turn)
    # Fades out over the last tenth of the grid, so that the faint shade from afar has no border.
    rows = visible_out.shape[0]
    columns = visible_out.shape[1]
    vertical = float(wp.min(row, rows - 1 - row)) / float(rows)
    horizontal = float(wp.min(column, columns - 1 - column)) / float(columns)
    visible_out[row, column] = wp.lerp(1.0, key + sky, wp.smoothstep(0.0, 0.1, wp.min(vertical, horizontal)))


@wp.func
def binomial(distance: wp.int32):
    """The weights 1 4 6 4 1 over 16."""
    weight = wp.float32(0.375)
    if wp.abs(distance) == 1:
        weight = 0.25
    if wp.abs(distance) == 2:
        weight = 0.0625
    return weight


@wp.kernel
def smooth_ground(
    # inputs:
    visible: wp.array2d[wp.float32],
    # outputs:
    visible_out: wp.array2d[wp.float32],
):
    """Binomial mean over 5 x 5 cells, which hides the pattern of the rays; beyond the grid the ground is lit."""
    row, column = wp.tid()
    total = wp.float32(0.0)
    for down in range(-2, 3):
        for across in range(-2, 3):
            j = row + down
            i = column + across
            value = wp.float32(1.0)
            if j >= 0 and j < visible.shape[0] and i >= 0 and i < visible.shape[1]:
                value = visible[j, i]
            total += binomial(down) * binomial(across) * value
    visible_out[row, column] = total


@wp.func
def look_up(texture: wp.array2d[wp.vec4], u: wp.float32, v: wp.float32):
    """Texture (top row first, texel centres at half integers, v upward), bilinear."""
    height = texture.shape[0]
    width = texture.shape[1]
    x = wp.clamp(u * float(width) - 0.5, 0.0, float(width - 1))
    y = wp.clamp((1.0 - v) * float(height) - 0.5, 0.0, float(height - 1))
    left = int(x)
    top = int(y)
    right = wp.min(left + 1, width - 1)
    bottom = wp.min(top + 1, height - 1)
    upper = wp.lerp(texture[top, left], texture[top, right], x - float(left))
    lower = wp.lerp(texture[bottom, left], texture[bottom, right], x - float(left))
    return wp.lerp(upper, lower, y - float(top))


@wp.func
def ground_light(ground: Ground, visible: wp.array2d[wp.float32], point: wp.vec3):
    """Part of the light that reaches a point of the ground, bilinear; 1 outside the grid."""
    x = (point[0] - ground.corner[0]) / ground.cell[0] - 0.5
    y = (point[1] - ground.corner[1]) / ground.cell[1] - 0.5
    light = wp.float32(1.0)
    if x >= 0.0 and y >= 0.0 and x < float(visible.shape[1] - 1) and y < float(visible.shape[0] - 1):
        i = int(x)
        j = int(y)
        low = wp.lerp(visible[j, i], visible[j, i + 1], x - float(i))
        high = wp.lerp(visible[j + 1, i], visible[j + 1, i + 1], x - float(i))
        light = wp.lerp(low, high, y - float(j))
    return light


@wp.func
def luminance(color: wp.vec3):
    """Luminance of linear RGB (ITU-R BT.709)."""
    return wp.dot(color, wp.vec3(0.2126, 0.7152, 0.0722))


@wp.func
def back_albedo(color: wp.vec3):
    """The side away from the photograph: paler and greyer."""
    grey = luminance(color)
    return wp.lerp(color, wp.vec3(grey, grey, grey), BACK_GREY) * BACK_GAIN + BACK_LIFT


@wp.func
def is_hole(surface: Surface, hit: wp.MeshQueryRay):
    """Whether the texture is cut out at a point of the mesh."""
    a = surface.uv[wp.mesh_get_index(surface.mesh, 3 * hit.face)]
    b = surface.uv[wp.mesh_get_index(surface.mesh, 3 * hit.face + 1)]
    c = surface.uv[wp.mesh_get_index(surface.mesh, 3 * hit.face + 2)]
    place = hit.u * a + hit.v * b + (1.0 - hit.u - hit.v) * c
    return look_up(surface.texture, place[0], place[1])[3] < HALF_OPAQUE


@wp.func
def first_leaf(surface: Surface, start: wp.vec3, ray: wp.vec3, offset: wp.float32):
    """Where a ray meets the leaf first, holes let through, and how far from the start that is."""
    hit = wp.mesh_query_ray(surface.mesh, start, ray, FAR)
    along = hit.t
    layer = wp.int32(0)
    while hit.result and surface.has_holes and layer < LAYERS:
        if not is_hole(surface, hit):
            break
        # The next layer of a folded leaf, or the ground, shows through.
        hit = wp.mesh_query_ray(surface.mesh, start + (along + offset) * ray, ray, FAR)
        along += offset + hit.t
        layer += 1
    return hit, along


@wp.func
def leaf_color(surface: Surface, lighting: Lighting, ray: wp.vec3, hit: wp.MeshQueryRay):
    """Light that leaves a point of the leaf against a ray."""
    a = wp.mesh_get_index(surface.mesh, 3 * hit.face)
    b = wp.mesh_get_index(surface.mesh, 3 * hit.face + 1)
    c = wp.mesh_get_index(surface.mesh, 3 * hit.face + 2)
    u = hit.u
    v = hit.v
    w = 1.0 - u - v
    place = u * surface.uv[a] + v * surface.uv[b] + w * surface.uv[c]
    normal = wp.normalize(u * surface.normals[a] + v * surface.normals[b] + w * surface.normals[c])
    light_visible = u * surface.light_visible[a] + v * surface.light_visible[b] + w * surface.light_visible[c]
    sky = u * surface.sky_visible[a] + v * surface.sky_visible[b] + w * surface.sky_visible[c]
    texel = look_up(surface.texture, place[0], place[1])
    color = wp.vec3(texel[0], texel[1], texel[2])
    if surface.tint.shape[0] > 0:
        tint = u * surface.tint[a] + v * surface.tint[b] + w * surface.tint[c]
        detail = wp.min(luminance(color) / surface.brightness, 1.7)  # pale veins would glow
        color = wp.lerp(color, detail * wp.vec3(tint[0], tint[1], tint[2]), wp.clamp(tint[3], 0.0, 1.0))
    sky_visible = sky[0]
    gloss = lighting.gloss
    through = wp.cw_mul(color, SHINE_TINT)
    if wp.dot(ray, hit.normal) > 0.0:
        normal = -normal
        sky_visible = sky[1]
        gloss = 0.3 * gloss
        color = back_albedo(color)
    facing = wp.dot(normal, lighting.to_light)
    ambient = wp.lerp(lighting.bounce, lighting.sky, 0.5 + 0.5 * normal[2]) * sky_visible
    key = lighting.key * light_visible
    result = color * (ambient + key * wp.max(facing, 0.0)) + through * (
        lighting.transmission * key * wp.max(-facing, 0.0)
    )
    if facing > 0.0:
        toward_half = wp.dot(normal, wp.normalize(lighting.to_light - ray))
        if toward_half > 0.8:  # below it the power is nothing
            shine = key * gloss * wp.pow(toward_half, GLOSS_EXPONENT)
            result += wp.vec3(shine, shine, shine)
    return result


@wp.func
def pixel_ray(camera: Camera, x: wp.float32, y: wp.float32):
    """Direction through a point of the picture; x and y in [0, 1] from the upper left corner."""
    return wp.normalize(camera.forward + (2.0 * x - 1.0) * camera.right + (1.0 - 2.0 * y) * camera.up)


@wp.func
def ray_color(
    surface: Surface,
    lighting: Lighting,
    ground: Ground,
    visible: wp.array2d[wp.float32],
    camera: Camera,
    x: wp.float32,
    y: wp.float32,
):
    """Colour along a ray and its distance to the leaf: positive on the photographed side, negative on the back,
    0 where there is no leaf. The ground never hides the leaf, so a leaf that sags through it stays in the picture."""
    ray = pixel_ray(camera, x, y)
    color = ground.color
    distance = wp.float32(0.0)
    hit, along_ray = first_leaf(surface, camera.position, ray, 0.1 * lighting.offset)
    if hit.result:
        color = leaf_color(surface, lighting, ray, hit)
        distance = along_ray
        if wp.dot(ray, hit.normal) > 0.0:
            distance = -along_ray
    elif ray[2] < 0.0:
        along = (ground.height - camera.position[2]) / ray[2]
        if along > 0.0:
            light = ground_light(ground, visible, camera.position + along * ray)
            color = ground.color * (1.0 - ground.shadow_depth * (1.0 - light))
    return color, distance


@wp.func
def encode(color: wp.float32, srgb: wp.array[wp.uint8]):
    """8-bit sRGB of one linear channel, by a table."""
    last = srgb.shape[0] - 1
    return srgb[int(wp.clamp(color, 0.0, 1.0) * float(last) + 0.5)]


@wp.kernel
def cast_pixels(
    # inputs:
    surface: Surface,
    lighting: Lighting,
    ground: Ground,
    visible: wp.array2d[wp.float32],
    camera: Camera,
    srgb: wp.array[wp.uint8],
    first_row: wp.int32,
    first_column: wp.int32,
    # outputs:
    picture_out: wp.array3d[wp.uint8],
    distance_out: wp.array2d[wp.float32],
):
    """One ray through the middle of each pixel: its colour, and the distance that :func:`ray_color` gives."""
    row, column = wp.tid()
    j = row + first_row
    i = column + first_column
    x = (float(i) + 0.5) / float(distance_out.shape[1])
    y = (float(j) + 0.5) / float(distance_out.shape[0])
    color, distance = ray_color(surface, lighting, ground, visible, camera, x, y)
    distance_out[j, i] = distance
    for channel in range(3):
        picture_out[j, i, channel] = encode(color[channel], srgb)


@wp.kernel
def smooth_outlines(
    # inputs:
    surface: Surface,
    lighting: Lighting,
    ground: Ground,
    visible: wp.array2d[wp.float32],
    camera: Camera,
    srgb: wp.array[wp.uint8],
    first_row: wp.int32,
    first_column: wp.int32,
    samples: wp.int32,
    distance: wp.array2d[wp.float32],
    # outputs:
    picture_out: wp.array3d[wp.uint8],
):
    """Cast samples x samples rays in each pixel whose distance differs from a neighbour's: an outline or a fold."""
    row, column = wp.tid()
    j = row + first_row
    i = column + first_column
    height = distance.shape[0]
    width = distance.shape[1]
    middle = distance[j, i]
    jump = wp.max(
        wp.max(wp.abs(distance[wp.max(j - 1, 0), i] - middle), wp.abs(distance[wp.min(j + 1, height - 1), i] - middle)),
        wp.max(wp.abs(distance[j, wp.max(i - 1, 0)] - middle), wp.abs(distance[j, wp.min(i + 1, width - 1)] - middle)),
    )
    if jump > camera.jump:
        total = wp.vec3(0.0, 0.0, 0.0)
        for sub_row in range(samples):
            for sub_column in range(samples):
                x = (float(i) + (float(sub_column) + 0.5) / float(samples)) / float(width)
                y = (float(j) + (float(sub_row) + 0.5) / float(samples)) / float(height)
                color, _distance = ray_color(surface, lighting, ground, visible, camera, x, y)
                # Clipped before the mean, or one glossy sample would leave a stair in the outline.
                total += wp.vec3(wp.min(color[0], 1.0), wp.min(color[1], 1.0), wp.min(color[2], 1.0))
        for channel in range(3):
            picture_out[j, i, channel] = encode(total[channel] / float(samples * samples), srgb)
