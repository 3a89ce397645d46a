"""Pictures of a leaf without a window or a graphics driver: rays cast by Warp kernels, on any Warp device."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
import warp as wp

from leafwarp.errors import InputError
from leafwarp.render.camera import View, checked_points, unit
from leafwarp.render.color import SRGB_OF_LINEAR, to_linear
from leafwarp_kernels import raycast

# Towards the key light: high, from behind on the left, so that shadows fall forward to the right.
LIGHT = (-0.40, 0.30, 0.87)
# From the leaf to the camera: from above the lower end of the photograph.
VIEW = (0.10, -0.62, 0.78)
PAPER = (250, 250, 248)  # sRGB of the ground in full light
LIGHT_RADIUS = 0.16  # tangent: a broad lamp, for soft shadows
SKY, BOUNCE = 0.40, 0.26
GLOSS, TRANSMISSION = 0.09, 0.35
SHADOW_DEPTH = 0.62
SHADOW_CELLS = 96  # along the longer side of the shadow
TEXELS_PER_PIXEL = 1.3


class LeafRenderer:
    """Draws one leaf in any pose, from a camera that stays where it is.

    A flat leaf that faces up shows its texture's colours as they are (without gloss): the light is scaled to that.

    Args:
        triangles: Vertex indices, counter-clockwise from the photographed side, shape [triangle_count, 3].
        uv: Texture coordinates, shape [vertex_count, 2], v upward.
        texture: 8-bit sRGB, top row first, shape [height, width, 3]; of a fourth channel, the opacity, less than half
            is a hole.
        device: Warp device.
        width: Of a picture [pixel].
        height: Of a picture [pixel].
        samples: Samples in each direction of a pixel at an outline; other pixels take one.
        light: Direction towards the key light.
        gloss: Strength of the reflected highlight; 0 for a matt leaf.

    Raises:
        InputError: A size is not positive, the light comes from below, or an index has no vertex.
    """

    def __init__(
        self,
        triangles: np.ndarray,
        uv: np.ndarray,
        texture: np.ndarray,
        device: str = "cpu",
        width: int = 1280,
        height: int = 720,
        samples: int = 4,
        light: Iterable[float] = LIGHT,
        gloss: float = GLOSS,
    ):
        if min(width, height, samples) < 1:
            raise InputError(f"picture {width} x {height}, samples {samples}: accepted: whole numbers of at least 1")
        self._light = unit(light)
        if self._light[2] < 0.1:
            raise InputError(f"light {tuple(self._light.round(3).tolist())} is not accepted; accepted: z above 0.1")
        self._triangles = np.ascontiguousarray(triangles, np.int32).reshape(-1, 3)
        if len(self._triangles) == 0 or self._triangles.min() < 0 or self._triangles.max() >= len(uv):
            raise InputError(f"triangles: accepted: at least one, with indices from 0 to {len(uv) - 1}")
        self.size = (width, height)
        self._samples = samples
        texture = np.asarray(texture, np.uint8)
        opacity = np.float32(texture[..., 3:] / 255.0) if texture.shape[2] == 4 else np.ones((*texture.shape[:2], 1))
        self._texture = np.dstack([to_linear(texture[..., :3]), opacity]).astype(np.float32)
        self._uv = np.asarray(uv, np.float64)
        self._gloss = gloss
        self.view: View | None = None
        self._mesh: wp.Mesh | None = None
        self._device = wp.get_device(device)
        self._allocate(len(uv))

    def set_camera(
        self, center: Iterable[float], radius: float, direction: Iterable[float] = VIEW, ground: float | None = None
    ) -> None:
        """Show a sphere.

        Args:
            center: Of the sphere [m].
            radius: Of the sphere [m], positive.
            direction: From the sphere to the camera.
            ground: Height of the ground [m]; the sphere's lowest point if None.

        Raises:
            InputError: The radius is not positive, or the direction is no direction.
        """
        if not radius > 0.0:
            raise InputError(f"radius {radius} is not accepted; accepted: a positive length")
        center = checked_points(np.asarray(center, np.float64))[0]
        view = View.around(center, radius, direction, self.size[0] / self.size[1])
        self._place(view, radius, center[2] - radius if ground is None else ground)

    def fit_camera(self, poses: Iterable[np.ndarray], direction: Iterable[float] = VIEW, margin: float = 0.04) -> None:
        """Show every one of these poses, and its shadow, whole; the ground lies just under the lowest point.

        Args:
            poses: Vertex positions [m], each of shape [vertex_count, 3].
            direction: From the leaf to the camera.
            margin: Empty border as a share of the picture.

        Raises:
            InputError: A position is not finite.
        """
        points = checked_points(np.concatenate([np.reshape(pose, (-1, 3)) for pose in poses]))
        radius = _radius(points)
        ground = ground_height(points)
        seen = np.concatenate([points, shadow_points(points, ground, self._light)])
        self._place(View.fitted(seen, direction, self.size[0] / self.size[1], margin), radius, ground)

    def render(self, points: np.ndarray, normals: np.ndarray, tint: np.ndarray | None = None) -> np.ndarray:
        """Draw a pose. Without a camera so far, it is fitted to this pose.

        Args:
            points: Vertex positions [m], shape [vertex_count, 3].
            normals: Unit vertex normals on the photographed side, shape [vertex_count, 3].
            tint: Linear RGB that the leaf takes on at its vertices, shape [vertex_count, 3], or with a fourth column
                of how much of it, in [0, 1]. The texture gives light and dark, relative to its mean.

        Returns:
            8-bit sRGB, top row first, shape [height, width, 3].

        Raises:
            InputError: A position is not finite, or an array has the wrong shape.
        """
        count = len(self._uv)
        for name, array, widths in (("points", points, (3,)), ("normals", normals, (3,)), ("tint", tint, (3, 4))):
            if array is not None and (np.ndim(array) != 2 or len(array) != count or np.shape(array)[1] not in widths):
                raise InputError(f"{name}: shape {np.shape(array)} is not accepted; accepted: ({count}, {widths[0]})")
        positions = checked_points(points)
        if self.view is None:
            self.fit_camera([points])
        self._upload(positions, normals, tint)
        self._light_scene(positions)
        return self._cast(positions)

    def _allocate(self, count: int) -> None:
        width, height = self.size
        with wp.ScopedDevice(self._device):
            self._indices = wp.array(self._triangles.reshape(-1), dtype=wp.int32)
            self._points = wp.zeros(count, dtype=wp.vec3)
            self._srgb = wp.array(SRGB_OF_LINEAR, dtype=wp.uint8)
            self._distance = wp.zeros((height, width), dtype=wp.float32)
            self._bare = np.full((height, width, 3), PAPER, np.uint8)
            self._picture = wp.array(self._bare, dtype=wp.uint8)
            self._surface = raycast.Surface()
            self._surface.uv = wp.array(self._uv.astype(np.float32), dtype=wp.vec2)
            self._surface.normals = wp.zeros(count, dtype=wp.vec3)
            self._surface.light_visible = wp.zeros(count, dtype=wp.float32)
            self._surface.sky_visible = wp.zeros(count, dtype=wp.vec2)
            self._tint = wp.zeros(count, dtype=wp.vec4)
            self._no_tint = wp.zeros(0, dtype=wp.vec4)

    def _place(self, view: View, radius: float, ground: float) -> None:
        """Keep a camera, and the lengths that belong to it."""
        self.view, self._radius = view, radius
        camera = raycast.Camera()
        camera.position = wp.vec3(*view.position)
        camera.forward = wp.vec3(*-view.back)
        camera.right = wp.vec3(*(view.half_size[0] * view.right))
        camera.up = wp.vec3(*(view.half_size[1] * view.up))
        self._camera = camera
        lighting = raycast.Lighting()
        lighting.to_light = wp.vec3(*self._light)
        lighting.disc_radius = LIGHT_RADIUS
        lighting.key = (1.0 - SKY) / self._light[2]
        lighting.sky, lighting.bounce = SKY, BOUNCE
        lighting.gloss, lighting.transmission = self._gloss, TRANSMISSION
        lighting.offset = 2e-3 * radius
        lighting.reach = 0.4 * radius
        self._lighting = lighting
        self._ground = raycast.Ground()
        self._ground.height = ground
        self._ground.color = wp.vec3(*to_linear(np.array(PAPER)).tolist())
        self._ground.shadow_depth = SHADOW_DEPTH
        self._surface.brightness = 0.0  # the texture awaits its reduction to the camera

    def _upload(self, points: np.ndarray, normals: np.ndarray, tint: np.ndarray | None) -> None:
        """The pose to the device, the texture if the camera is new, and the mesh's tree brought up to date."""
        self._points.assign(points.astype(np.float32))
        self._surface.normals.assign(np.nan_to_num(np.asarray(normals, np.float32)))
        if tint is None:
            self._surface.tint = self._no_tint
        else:
            tint = np.asarray(tint, np.float32)
            full = tint if tint.shape[1] == 4 else np.column_stack([tint, np.ones(len(tint), np.float32)])
            self._tint.assign(full)
            self._surface.tint = self._tint
        if self._mesh is None:
            self._mesh = wp.Mesh(self._points, self._indices)
            self._surface.mesh = self._mesh.id
        else:
            self._mesh.refit()
        # Distance between neighbouring pixels on a surface that is seen at 80 degrees.
        pixel = 2.0 * self.view.half_size[0] / self.size[0] * np.linalg.norm(points.mean(axis=0) - self.view.position)
        self._camera.jump = 6.0 * pixel
        if self._surface.brightness == 0.0:
            self._reduce_texture(points, pixel)

    def _reduce_texture(self, points: np.ndarray, pixel: float) -> None:
        """The texture with about one texel a pixel; a finer one would flicker, and an area mean is better than rays."""
        corners, places = points[self._triangles], self._uv[self._triangles]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
        (a, b), (c, d) = (places[:, 1] - places[:, 0]).T, (places[:, 2] - places[:, 0]).T
        height, width = self._texture.shape[:2]
        texels = np.abs(a * d - b * c).sum() * width * height
        scale = TEXELS_PER_PIXEL * np.sqrt(area / max(texels, 1e-12)) / max(pixel, 1e-12)
        texture = self._texture
        if scale < 1.0:
            size = max(1, round(scale * width)), max(1, round(scale * height))
            texture = cv2.resize(texture, size, interpolation=cv2.INTER_AREA)
        rows, columns = texture.shape[:2]
        column = np.clip((self._uv[:, 0] * columns).astype(np.int64), 0, columns - 1)
        row = np.clip(((1.0 - self._uv[:, 1]) * rows).astype(np.int64), 0, rows - 1)
        luminance = texture[row, column, :3] @ np.array([0.2126, 0.7152, 0.0722])
        self._surface.texture = wp.array(texture, dtype=wp.vec4, device=self._device)
        self._surface.has_holes = bool(texture[..., 3].min() < 0.5)
        self._surface.brightness = max(float(luminance.mean()), 1e-4)

    def _light_scene(self, points: np.ndarray) -> None:
        """Visibility of the light and the sky, at the vertices and on the ground."""
        self._launch(
            raycast.light_vertices,
            len(self._uv),
            [self._surface, self._points, self._lighting],
            [self._surface.light_visible, self._surface.sky_visible],
        )
        low, high = self._shadow_box(points)
        extent = high - low
        shape = np.clip(np.ceil(SHADOW_CELLS * extent / extent.max()), 16, SHADOW_CELLS).astype(int)
        self._ground.corner = wp.vec2(*low)
        self._ground.cell = wp.vec2(*(extent / shape))
        cells = (int(shape[1]), int(shape[0]))
        rough = wp.empty(cells, dtype=wp.float32, device=self._device)
        self._visible = wp.empty(cells, dtype=wp.float32, device=self._device)
        self._launch(raycast.shade_ground, cells, [self._mesh.id, self._lighting, self._ground], [rough])
        self._launch(raycast.smooth_ground, cells, [rough], [self._visible])

    def _shadow_box(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rectangle of the ground that any shadow can reach, with a border for the smoothing."""
        ground = float(self._ground.height)
        places = shadow_points(points, ground, self._light)[:, :2]
        rise = max(float(points[:, 2].max()) - ground, 0.0)
        border = LIGHT_RADIUS * rise / self._light[2] ** 2 + 0.7 * min(rise, self._lighting.reach) + 0.05 * self._radius
        return places.min(axis=0) - border, places.max(axis=0) + border

    def _cast(self, points: np.ndarray) -> np.ndarray:
        """The pixels that leaf or shadow can reach; the others are bare ground."""
        low, high = self._shadow_box(points)
        ground = float(self._ground.height)
        corners = np.array([[x, y, ground] for x in (low[0], high[0]) for y in (low[1], high[1])])
        left, top, right, bottom = self._seen_box(np.concatenate([points, corners]))
        if right <= left or bottom <= top:
            return self._bare.copy()
        shape = (bottom - top, right - left)
        scene = [self._surface, self._lighting, self._ground, self._visible, self._camera, self._srgb, top, left]
        self._picture.assign(self._bare)
        self._distance.zero_()
        self._launch(raycast.cast_pixels, shape, scene, [self._picture, self._distance])
        if self._samples > 1:
            outlines = [*scene, self._samples, self._distance]
            self._launch(raycast.smooth_outlines, shape, outlines, [self._picture])
        return self._picture.numpy().copy()

    def _seen_box(self, points: np.ndarray) -> tuple[int, int, int, int]:
        """Left, top, right and bottom of the pixels around points; the whole picture where one is behind the camera."""
        width, height = self.size
        places = self.view.project(points)
        if (places[:, 2] <= 0.0).any():
            return 0, 0, width, height
        low = np.floor(np.clip(places[:, :2].min(axis=0), -1.0, 2.0) * self.size).astype(int) - 1
        high = np.ceil(np.clip(places[:, :2].max(axis=0), -1.0, 2.0) * self.size).astype(int) + 1
        left, top = np.clip(low, 0, self.size).tolist()
        right, bottom = np.clip(high, 0, self.size).tolist()
        return left, top, right, bottom

    def _launch(self, kernel: wp.Kernel, dim: int | tuple[int, ...], inputs: list, outputs: list) -> None:
        wp.launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=self._device)


def _radius(points: np.ndarray) -> float:
    """Half the diagonal of the box around points [m], positive."""
    return max(0.5 * float(np.linalg.norm(np.ptp(points, axis=0))), 1e-9)


def ground_height(points: np.ndarray) -> float:
    """Height of a ground just below points [m]."""
    return float(points[:, 2].min()) - 0.03 * _radius(points)


def shadow_points(points: np.ndarray, ground: float, light: Iterable[float] = LIGHT) -> np.ndarray:
    """Where points throw their shadow on the ground [m], shape [count, 3]."""
    light = unit(light)
    along = np.maximum(points[:, 2:] - ground, 0.0) / light[2]
    return np.concatenate([points[:, :2] - along * light[:2], np.full((len(points), 1), ground)], axis=1)
