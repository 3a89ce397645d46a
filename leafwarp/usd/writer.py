"""Writing a leaf's animation so that a crash loses no finished frame.

While a run lasts the root, written once, holds value clips by a file name template; every finished frame is a
file of its own that appears by a rename. So at any moment, also after ``kill -9``, the root opens with every
finished frame at its time code. At the end all frames are merged into one file, renamed over the root, and
the frame files are removed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np
from pxr import Sdf

from leafwarp.errors import InputError, OutputError
from leafwarp.frame import Frame
from leafwarp.leaf.leaf import Leaf
from leafwarp.png import encode_png
from leafwarp.usd.attributes import UP_AXES, animated_attributes, frame_values
from leafwarp.usd.files import Files, reported
from leafwarp.usd.layers import (
    StageFacts,
    clips_root_layer,
    frame_layer,
    manifest_layer,
    rest_layer,
    set_textures,
)
from leafwarp.usd.prims import Prims


class UsdWriter:
    """Writes a leaf, or many, with their texture and their frames to a USD file.

    As a context manager it closes the file at the end of the block; an exception inside leaves the frames
    written so far as they are, readable through the root.

    Args:
        path: The USD to write: ``.usd`` and ``.usdc`` binary, ``.usda`` text. What is there is replaced.
        leaf: The leaf, or the leaves: topology, ``st`` and texture.
        rest: The rest pose, the default value of everything animated.
        frames: The frame numbers to come, which are the time codes; non-negative, rising.
        fps: Playback frames per second.
        display_color: Whether frames bring ``primvars:displayColor``; the asset then has a variant set
            ``shading`` that switches between the photo and that colour.
        up_axis: ``"Z"``, or ``"Y"`` with every vector (x, y, z) turned to (x, z, -y).
        metadata: Facts of the run to keep in the file. Anything that differs from run to run, such as a date,
            costs the byte identity of two runs.

    Raises:
        InputError: The suffix of ``path`` or the up axis is not accepted.
        OutputError: Something cannot be written.
    """

    def __init__(
        self,
        path: Path,
        leaf: Leaf,
        rest: Frame,
        *,
        frames: range,
        fps: float,
        display_color: bool = False,
        up_axis: str = "Z",
        metadata: Mapping[str, str] | None = None,
    ):
        if up_axis not in UP_AXES:
            raise InputError(f"up_axis: {up_axis!r} is not accepted; accepted: {', '.join(UP_AXES)}")
        if len(frames) == 0 or frames.step < 1 or frames[0] < 0:
            raise ValueError(f"frames: {frames} is not accepted; accepted: a rising range from 0 or later")
        self._prims = Prims.of(leaf)
        self._files = Files.beside(Path(path), frames[-1], photos=len(leaf.photos))
        self._facts = StageFacts(self._prims.root, frames, fps, up_axis, dict(metadata or {}))
        self._attributes = animated_attributes(display_color)
        rest_pose = self._values(rest)
        self._animated_paths = tuple(rest_pose)
        self._rest_layer = rest_layer(self._prims, self._attributes, rest_pose, self._facts)
        self._written: set[int] = set()
        self._closed = False
        self._begin([photo.texture for photo in leaf.photos])

    def _begin(self, textures: Sequence[np.ndarray]) -> None:
        """Put in place all that does not move, in an order that never leaves a root incomplete."""
        files = self._files
        files.make_frame_folder()
        keep_leftovers = files.has_leftovers()
        try:
            for file, texture in zip(files.textures, textures, strict=True):
                png = encode_png(texture)
                files.publish(file, lambda aside, png=png: aside.write_bytes(png), durable=True)
            if keep_leftovers:
                # The root that an earlier, killed run left refers to those frames: replace it before they go.
                files.publish_layer(files.root, self._merged([]))
                keep_leftovers = False
                files.remove_frame_folder()
                files.make_frame_folder()
            self._set_textures(self._rest_layer, files.rest)
            files.publish_layer(files.rest, self._rest_layer)
            files.publish_layer(files.manifest, manifest_layer(self._prims.leaves, self._attributes))
            files.publish_layer(files.root, clips_root_layer(files, self._facts))
        except OutputError:
            if not keep_leftovers:
                files.remove_frame_folder()
            raise

    def write(self, frame: Frame) -> None:
        """Write one frame; when this returns, the frame survives the end of the process.

        Raises:
            ValueError: The frame was not announced, came before, or its arrays do not fit the mesh.
            SimulationError: The frame holds NaN or infinite values.
            OutputError: The frame cannot be written; the frames before it stay readable.
        """
        if self._closed:
            raise ValueError(f"frame {frame.index}: {self._files.root} is closed")
        if frame.index not in self._facts.frames or frame.index in self._written:
            raise ValueError(f"frame {frame.index}: not one of {self._facts.frames}, or written before")
        layer = frame_layer(frame.index, self._values(frame), self._prims.leaves, self._attributes)
        self._files.publish_layer(self._files.frame(frame.index), layer)
        self._written.add(frame.index)

    def close(self) -> Path:
        """Merge the frames into one file in the root's place and remove the frame files.

        Frames that never came narrow the file's time range.

        Returns:
            The absolute path of the USD.

        Raises:
            OutputError: The merged file cannot be written; every frame stays readable through the root.
        """
        if not self._closed:
            self._files.publish_layer(self._files.root, self._merged(sorted(self._written)), durable=True)
            self._files.remove_frame_folder()
            self._closed = True
        return self._files.root

    def _values(self, frame: Frame) -> dict[Sdf.Path, object]:
        return frame_values(frame, self._attributes, self._prims.leaves, self._facts.up_axis)

    def _set_textures(self, layer: Sdf.Layer, place: Path) -> None:
        files = self._files
        set_textures(layer, self._prims, [files.asset_path(texture, place) for texture in files.textures])

    def _merged(self, indices: list[int]) -> Sdf.Layer:
        """The rest layer with the time samples of the frame files."""
        merged = Sdf.Layer.CreateAnonymous("merged.usdc")
        merged.TransferContent(self._rest_layer)
        self._set_textures(merged, self._files.root)
        if indices:
            self._facts.author(merged, first=indices[0], last=indices[-1])
        for index in indices:
            file = self._files.frame(index)
            with reported(file, "read"):
                clip = Sdf.Layer.OpenAsAnonymous(str(file))
            with Sdf.ChangeBlock():
                for path in self._animated_paths:
                    merged.SetTimeSample(path, float(index), clip.QueryTimeSample(path, float(index)))
        return merged

    def __enter__(self) -> UsdWriter:
        """The writer itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file, unless an exception is on its way: the frames then stay as they are."""
        if kind is None:
            self.close()
