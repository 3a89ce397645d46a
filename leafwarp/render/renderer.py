"""Pictures of a leaf without a window or a graphics driver: ray casting in a Warp kernel, on any Warp device."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
import warp as wp

from leafwarp.errors import InputError
from leafwarp_kernels import raycast

# Toward the key light: from the upper left, behind the camera's shoulder.
LIGHT = np.array([-0.28, 0.22, 0.93]) / np.linalg.norm([-0.28, 0.22, 0.93])
# From the leaf to the camera: from above the petiole, looking along the leaf.
VIEW = np.array([0.12, -0.60, 0.79]) / np.linalg.norm([0.12, -0.60, 0.79])
FIELD_OF_VIEW = np.radians(24.0)  # of the picture's longer side
GROUND_COLOR = 0.93  # linear grey
SHADOW_CELLS = 256
SHADOW_SOFTNESS = 0.02  # blur of the shadow over the leaf's radius


def _encode(linear: np.ndarray) -> np.ndarray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


def _decode(encoded: np.ndarray) -> np.ndarray:
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


# Tables are several times faster than powers for every pixel; 2^14 steps leave less than an 8-bit step of error.
_LINEAR_STEPS = 2**14
_LINEAR_OF_SRGB = _decode(np.arange(256) / 255.0).astype(np.float32)
_SRGB_OF_LINEAR = np.round(255.0 * _encode(np.arange(_LINEAR_STEPS + 1) / _LINEAR_STEPS)).astype(np.uint8)


def to_linear(color: np.ndarray) -> np.ndarray:
    """Linear RGB in [0, 1] of 8-bit sRGB, float32."""
    return _LINEAR_OF_SRGB[color]


def to_srgb(color: np.ndarray) -> np.ndarray:
    """8-bit sRGB of linear RGB."""
    return _SRGB_OF_LINEAR[(np.clip(color, 0.0, 1.0) * _LINEAR_STEPS + 0.5).astype(np.uint16)]


class LeafRenderer:
    """Draws one leaf in any pose, from a camera that stays where it is.

    Args:
        triangles: Vertex indices, shape [triangle_count, 3].
        uv: Texture coordinates, shape [vertex_count, 2], v upward.
        texture: 8-bit sRGB, top row first, shape [height, width, 3].
        size: Width and height of a picture [pixel].
        samples: Samples a pixel in each direction.
        device: Warp device.
    """

    def __init__(
        self,
        triangles: np.ndarray,
        uv: np.ndarray,
        texture: np.ndarray,
        size: tuple[int, int] = (1280, 720),
        samples: int = 1,
        device: str = "cpu",
    ):
        self._device = wp.get_device(device)
        self._size = size
        self._samples = samples
        with wp.ScopedDevice(self._device):
            # A texel a sample is enough; more would alias.
            limit = samples * max(size)
            scale = min(1.0, limit / max(texture.shape[:2]))
            if scale < 1.0:
                texture = cv2.resize(texture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            self._texture = wp.array(to_linear(texture), dtype=wp.vec3f)
            self._uv = wp.array(np.asarray(uv, np.float32), dtype=wp.vec2f)
            self._indices = wp.array(np.asarray(triangles, np.int32).reshape(-1), dtype=wp.int32)
            self._points = wp.zeros(len(uv), dtype=wp.vec3f)
            self._normals = wp.zeros(len(uv), dtype=wp.vec3f)
            self._shadow = wp.zeros((SHADOW_CELLS, SHADOW_CELLS), dtype=wp.float32)
            self._picture = wp.zeros((size[1] * samples, size[0] * samples), dtype=wp.vec3f)
        self._mesh: wp.Mesh | None = None
        self._camera: raycast.Camera | None = None

    def frame(self, poses: Iterable[np.ndarray], margin: float = 0.08, view: np.ndarray = VIEW) -> None:
        """Place camera and ground so that every one of these poses is seen whole.

        Args:
            poses: Vertex positions [m], each of shape [vertex_count, 3].
            margin: Space around them as a share of the picture.
            view: Direction from the leaf to the camera.

        Raises:
            InputError: A position is not finite.
        """
        points = np.concatenate([np.asarray(p, np.float64) for p in poses])
        if not np.isfinite(points).all():
            raise InputError("a leaf with a position that is not a finite number cannot be drawn")
        low, high = points.min(axis=0), points.max(axis=0)
        radius = max(0.5 * np.linalg.norm(high - low), 1e-6)
        width, height = self._size
        half = np.tan(0.5 * FIELD_OF_VIEW) * np.array([width, height]) / max(width, height)
        back = view / np.linalg.norm(view)
        level = np.array([1.0, 0.0, 0.0]) if abs(back[2]) > 0.999 else np.cross([0.0, 0.0, 1.0], back)
        right = level / np.linalg.norm(level)
        up = np.cross(back, right)
        center = 0.5 * (low + high)
        for _ in range(3):
            offset = points - center
            across, upward, toward = offset @ right, offset @ up, offset @ back
            shift = [0.5 * (values.min() + values.max()) for values in (across, upward)]
            center = center + shift[0] * right + shift[1] * up
        reach = (1.0 + 2.0 * margin) * np.abs(np.stack([across - shift[0], upward - shift[1]], axis=1)) / half
        distance = max(float((reach + toward[:, None]).max()), 1e-6)
        camera = raycast.Camera()
        camera.eye = wp.vec3f(*(center + distance * back))
        camera.forward = wp.vec3f(*-back)
        camera.right = wp.vec3f(*(half[0] * right))
        camera.up = wp.vec3f(*(half[1] * up))
        self._camera = camera
        self._radius = radius
        self._reach = 4.0 * (distance + radius)
        self._ground = raycast.Ground()
        self._ground.height = float(low[2] - 0.04 * radius)
        middle = 0.5 * (low + high)
        self._ground.low = wp.vec2f(*(middle[:2] - 2.0 * radius))
        self._ground.size = float(4.0 * radius)

    def render(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Draw a pose.

        Args:
            points: Vertex positions [m], shape [vertex_count, 3].
            normals: Unit vertex normals, shape [vertex_count, 3].

        Returns:
            8-bit sRGB, top row first, shape [height, width, 3].

        Raises:
            InputError: A position is not finite.
        """
        if not np.isfinite(points).all():
            raise InputError("a leaf with a position that is not a finite number cannot be drawn")
        if self._camera is None:
            self.frame([points])
        self._points.assign(np.asarray(points, np.float32))
        self._normals.assign(np.asarray(normals, np.float32))
        if self._mesh is None:
            self._mesh = wp.Mesh(self._points, self._indices)
        else:
            self._mesh.refit()
        light = wp.vec3f(*LIGHT)
        reach = float(self._reach)
        wp.launch(
            raycast.cast_shadow,
            dim=self._shadow.shape,
            inputs=[self._mesh.id, self._ground, light, reach],
            outputs=[self._shadow],
            device=self._device,
        )
        blur = SHADOW_SOFTNESS * SHADOW_CELLS * self._radius / self._ground.size * 4.0
        self._shadow.assign(cv2.GaussianBlur(self._shadow.numpy(), (0, 0), blur))
        wp.launch(
            raycast.render,
            dim=self._picture.shape,
            inputs=[
                self._mesh.id, self._normals, self._uv, self._texture, self._camera, light, self._ground,
                wp.vec3f(GROUND_COLOR), self._shadow, reach,
            ],
            outputs=[self._picture],
            device=self._device,
        )  # fmt: skip
        picture = self._picture.numpy()
        if self._samples > 1:
            picture = cv2.resize(picture, self._size, interpolation=cv2.INTER_AREA)
        return to_srgb(picture)
