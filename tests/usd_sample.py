"""A small leaf made by hand, and frames of it bending, for the tests of the USD output.

Run as a script it is the child process of the kill and full-disk tests: it writes frames and says on stdout,
one flushed line each, what is finished.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from pathlib import Path

import numpy as np

from leafwarp.frame import Frame
from leafwarp.leaf.leaf import Leaf, LeafMesh, MapFrame

FPS = 30.0  # not USD's default of 24: a time code must not be rescaled by it


def sample_leaf(columns: int = 5, rows: int = 8) -> Leaf:
    """A triangulated rectangle of 0.05 m by 0.08 m with a texture that tells its corners apart."""
    x, y = np.meshgrid(np.linspace(-0.025, 0.025, columns), np.linspace(0.0, 0.08, rows))
    positions = np.stack((x.ravel(), y.ravel()), axis=1)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack((corner, corner + 1, corner + columns + 1), axis=1)
    upper = np.stack((corner, corner + columns + 1, corner + columns), axis=1)
    triangles = np.concatenate((lower, upper)).astype(np.int32)
    no_springs = np.zeros((0, 4), np.int32)
    mesh = LeafMesh(positions, triangles, no_springs[:, :2], no_springs, np.zeros(0), np.zeros(len(positions)))
    texture = np.zeros((16, 12, 3), np.uint8)
    texture[:8, :6], texture[:8, 6:], texture[8:, :6], texture[8:, 6:] = (
        (200, 30, 20),
        (30, 180, 40),
        (20, 40, 220),
        (210, 200, 30),
    )
    return Leaf(mesh, MapFrame((-0.03, -0.005), (0.06, 0.09)), 0.08, texture)


def sample_frame(leaf: Leaf, index: int, count: int = 24, color: bool = False) -> Frame:
    """The leaf rolled about the x axis to an arc that tightens with the frame; frame 0 is flat."""
    positions = leaf.mesh.positions
    curvature = 1e-9 + 25.0 * index / count
    angle = positions[:, 1] * curvature
    points = np.stack((positions[:, 0], np.sin(angle) / curvature, (1 - np.cos(angle)) / curvature), axis=1)
    normals = np.stack((np.zeros_like(angle), -np.sin(angle), np.cos(angle)), axis=1)
    water = 1.0 - 0.9 * index / count * (0.5 + 0.5 * leaf.uv[:, 1])
    tint = np.stack((0.4 - 0.3 * water, 0.1 + 0.2 * water, 0.1 - 0.05 * water), axis=1)
    return Frame(
        index=index,
        plant_time=60.0 * index,
        points=points.astype(np.float32),
        normals=normals.astype(np.float32),
        velocities=(normals * 0.01 * index).astype(np.float32),
        water=water.astype(np.float32),
        color=tint.astype(np.float32) if color else None,
    )


def write_sample(path: Path, count: int = 6, color: bool = False, leaf: Leaf | None = None, **options) -> Path:
    """Write ``count`` frames of the sample leaf to ``path``."""
    from leafwarp.usd.writer import UsdWriter

    leaf = leaf or sample_leaf()
    rest = sample_frame(leaf, 0, count, color)
    frames = range(1, count + 1)
    with UsdWriter(path, leaf, rest, frames=frames, fps=FPS, display_color=color, **options) as writer:
        for index in frames:
            writer.write(sample_frame(leaf, index, count, color))
    return path


def open_afresh(path: Path):
    """The stage of a USD as the file says it now, whatever this process has read of it before."""
    from pxr import Sdf, Usd

    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.Reload()
    stage = Usd.Stage.Open(layer)
    stage.Reload()
    return stage


def say(line: str) -> None:
    """One line to the parent, at once."""
    print(line, flush=True)


def limit_file_size(size: int) -> None:
    """Make every write past ``size`` bytes of a file fail, as on a full disk."""
    import resource

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))


def kill_at(event: str, count: int, folder: Path) -> None:
    """Die by SIGKILL when this process is about to do ``event`` in ``folder`` for the ``count``-th time.

    Args:
        event: Audit event of the interpreter: ``os.rename`` or ``os.remove``.
        count: From 1.
        folder: Only what happens to files below it counts.
    """
    left = count

    def hook(name: str, arguments: tuple) -> None:
        nonlocal left
        if name == event and str(arguments[0]).startswith(str(folder)):
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)


def main() -> int:
    """Write frames, telling the parent; a failure is told as ``failed MESSAGE``."""
    from leafwarp.errors import OutputError
    from leafwarp.usd.writer import UsdWriter

    parser = argparse.ArgumentParser()
    parser.add_argument("path", type=Path)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--columns", type=int, default=5)
    parser.add_argument("--rows", type=int, default=8)
    parser.add_argument("--limit-after", type=int, help="finished frames before the file size limit applies")
    parser.add_argument("--limit", type=int, help="file size limit [bytes]")
    parser.add_argument("--kill-at", help="EVENT:COUNT, where the process kills itself")
    options = parser.parse_args()

    leaf = sample_leaf(options.columns, options.rows)
    if options.kill_at:
        event, count = options.kill_at.split(":")
        kill_at(event, int(count), options.path.parent)
    frames = range(1, options.count + 1)
    try:
        rest = sample_frame(leaf, 0, options.count)
        with UsdWriter(options.path, leaf, rest, frames=frames, fps=FPS) as writer:
            say("ready")
            for index in frames:
                writer.write(sample_frame(leaf, index, options.count))
                say(f"frame {index}")
                if options.limit_after == index:
                    limit_file_size(options.limit)
            say("merging")
        say("closed")
    except OutputError as error:
        say(f"failed {error}")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
