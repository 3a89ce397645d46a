"""Pictures of a thin two-sided surface over a ground plane, one camera ray a sample.

A hit takes its colour from the texture by bilinear interpolation (texel centres at half integers, v upward), is lit
by one distant key light and by a hemisphere (sky above, ground below), and lets some of the light through from behind.
The side away from the photograph is paler. The shadow on the ground is found once a picture on a grid and blurred.
All colours are linear RGB. Rendering has one precision, float32.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

KEY = wp.constant(wp.float32(0.82))
SKY = wp.constant(wp.float32(0.42))
BOUNCE = wp.constant(wp.float32(0.30))
SHINE_THROUGH = wp.constant(wp.float32(0.28))
BACK_PALENESS = wp.constant(wp.float32(0.38))
SHADOW_DEPTH = wp.constant(wp.float32(0.55))


@wp.struct
class Camera:
    """A pinhole camera; right and up reach from the middle of the picture to its edges at distance 1."""

    eye: wp.vec3f
    forward: wp.vec3f
    right: wp.vec3f
    up: wp.vec3f


@wp.struct
class Ground:
    """The horizontal plane that takes the shadow, and the square of it that the shadow grid covers."""

    height: wp.float32
    low: wp.vec2f
    size: wp.float32


@wp.func
def look_up(texture: wp.array2d[wp.vec3f], u: wp.float32, v: wp.float32):
    """Colour of the texture (top row first) at map coordinates, bilinear."""
    height = texture.shape[0]
    width = texture.shape[1]
    x = wp.clamp(u * wp.float32(width) - 0.5, 0.0, wp.float32(width - 1))
    y = wp.clamp((1.0 - v) * wp.float32(height) - 0.5, 0.0, wp.float32(height - 1))
    left = wp.min(wp.int32(x), width - 1)
    top = wp.min(wp.int32(y), height - 1)
    right = wp.min(left + 1, width - 1)
    bottom = wp.min(top + 1, height - 1)
    across = x - wp.float32(left)
    down = y - wp.float32(top)
    upper = (1.0 - across) * texture[top, left] + across * texture[top, right]
    lower = (1.0 - across) * texture[bottom, left] + across * texture[bottom, right]
    return (1.0 - down) * upper + down * lower


@wp.func
def shadow_at(shadow: wp.array2d[wp.float32], ground: Ground, point: wp.vec3f):
    """Share of the key light that is missing at a point of the ground, bilinear."""
    size = shadow.shape[0]
    x = (point[0] - ground.low[0]) / ground.size * wp.float32(size) - 0.5
    y = (point[1] - ground.low[1]) / ground.size * wp.float32(size) - 0.5
    inside = x >= 0.0 and y >= 0.0 and x < wp.float32(size - 1) and y < wp.float32(size - 1)
    share = wp.float32(0.0)
    if inside:
        i = wp.int32(x)
        j = wp.int32(y)
        across = x - wp.float32(i)
        up = y - wp.float32(j)
        low = (1.0 - across) * shadow[j, i] + across * shadow[j, i + 1]
        high = (1.0 - across) * shadow[j + 1, i] + across * shadow[j + 1, i + 1]
        share = (1.0 - up) * low + up * high
    return share


@wp.kernel
def cast_shadow(
    # inputs:
    mesh: wp.uint64,
    ground: Ground,
    light: wp.vec3f,
    reach: wp.float32,
    # outputs:
    shadow_out: wp.array2d[wp.float32],
):
    """1 where the leaf is between a point of the ground and the light, 0 elsewhere."""
    j, i = wp.tid()
    spacing = ground.size / wp.float32(shadow_out.shape[0])
    point = wp.vec3f(
        ground.low[0] + (wp.float32(i) + 0.5) * spacing, ground.low[1] + (wp.float32(j) + 0.5) * spacing, ground.height
    )
    barred = wp.mesh_query_ray_anyhit(mesh, point, light, reach)
    shadow_out[j, i] = wp.where(barred, 1.0, 0.0)


@wp.kernel
def render(
    # inputs:
    mesh: wp.uint64,
    normal: wp.array[wp.vec3f],
    uv: wp.array[wp.vec2f],
    texture: wp.array2d[wp.vec3f],
    camera: Camera,
    light: wp.vec3f,
    ground: Ground,
    ground_color: wp.vec3f,
    shadow: wp.array2d[wp.float32],
    reach: wp.float32,
    # outputs:
    picture_out: wp.array2d[wp.vec3f],
):
    """Linear RGB of every sample of the picture, top row first."""
    j, i = wp.tid()
    x = 2.0 * (wp.float32(i) + 0.5) / wp.float32(picture_out.shape[1]) - 1.0
    y = 1.0 - 2.0 * (wp.float32(j) + 0.5) / wp.float32(picture_out.shape[0])
    ray = wp.normalize(camera.forward + x * camera.right + y * camera.up)
    hit = wp.mesh_query_ray(mesh, camera.eye, ray, reach)
    color = ground_color
    if hit.result:
        a = wp.mesh_get_index(mesh, 3 * hit.face)
        b = wp.mesh_get_index(mesh, 3 * hit.face + 1)
        c = wp.mesh_get_index(mesh, 3 * hit.face + 2)
        w = 1.0 - hit.u - hit.v
        smooth = wp.normalize(hit.u * normal[a] + hit.v * normal[b] + w * normal[c])
        place = hit.u * uv[a] + hit.v * uv[b] + w * uv[c]
        albedo = look_up(texture, place[0], place[1])
        if wp.dot(ray, hit.normal) > 0.0:
            smooth = -smooth
            grey = (albedo[0] + albedo[1] + albedo[2]) / 3.0
            pale = 1.15 * grey + 0.06
            albedo = (1.0 - BACK_PALENESS) * albedo + BACK_PALENESS * wp.vec3f(pale, pale, pale)
        facing = wp.dot(smooth, light)
        direct = SHINE_THROUGH * wp.max(-facing, 0.0)
        if facing > 0.0:
            side = wp.where(wp.dot(ray, hit.normal) > 0.0, -1.0, 1.0)
            start = camera.eye + hit.t * ray + (2.0e-4 * reach * side) * hit.normal
            if not wp.mesh_query_ray_anyhit(mesh, start, light, reach):
                direct += facing
        ambient = 0.5 * SKY * (1.0 + smooth[2]) + 0.5 * BOUNCE * (1.0 - smooth[2])
        color = (KEY * direct + ambient) * albedo
    elif ray[2] < 0.0:
        distance = (ground.height - camera.eye[2]) / ray[2]
        if distance > 0.0:
            color = (1.0 - SHADOW_DEPTH * shadow_at(shadow, ground, camera.eye + distance * ray)) * ground_color
    picture_out[j, i] = color
