"""The files of a USD output, and how each comes to be there: written aside, then renamed into its place.

A rename within a folder is atomic, so whoever opens a name finds the whole old file or the whole new one,
also after ``kill -9``: what a process has written stays with the operating system. Only where a later step
destroys the data's other copy is the file forced to the disk first, so that a power cut cannot lose both.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pxr import Sdf, Tf

from leafwarp.errors import InputError, OutputError
from leafwarp.files import texture_path

SUFFIXES = (".usd", ".usda", ".usdc")
_ASIDE = "writing"  # stem of the file under way; USD itself writes to this name and a random tail first


@contextlib.contextmanager
def reported(path: Path, action: str = "written") -> Iterator[None]:
    """Turn a failure of the operating system or of USD into one line that names ``path`` and the reason."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: cannot be {action}: {error.strerror or error}") from error
    except Tf.ErrorException as error:
        raise OutputError(f"{path}: cannot be {action}: {_reason(str(error))}") from error


def _reason(diagnostic: str) -> str:
    """The operating system's reason in a USD diagnostic of many lines, else its first message."""
    for code in sorted(errno.errorcode):
        if os.strerror(code) in diagnostic:
            return os.strerror(code)
    _, _, message = diagnostic.strip().splitlines()[0].partition(" : ")
    return message.strip("'") or diagnostic.strip().splitlines()[0]


@dataclass(frozen=True)
class Files:
    """The files of one USD output.

    Attributes:
        root: The USD that the user asked for.
        textures: The texture of each photo, in the same folder.
        frame_folder: Folder of what exists during a run only: one file a frame, the rest pose, the manifest.
            It carries the root's whole name, so that ``a.usd`` and ``a.usda`` do not share it.
        frame_digits: Digits of a frame number in a file name.
    """

    root: Path
    textures: tuple[Path, ...]
    frame_folder: Path
    frame_digits: int

    @classmethod
    def beside(cls, path: Path, last_frame: int, photos: int = 1) -> Files:
        """The files of the USD at ``path``.

        Args:
            path: The USD.
            last_frame: The largest frame number.
            photos: Number of photos that leaves are made from.

        Raises:
            InputError: The suffix is none of a USD file's.
        """
        if path.suffix.lower() not in SUFFIXES:
            accepted = ", ".join(SUFFIXES)
            raise InputError(f"{path}: suffix {path.suffix!r} is not accepted; accepted: {accepted}")
        path = path.absolute()
        return cls(
            root=path,
            textures=tuple(texture_path(path, index) for index in range(photos)),
            frame_folder=path.with_name(f"{path.name}.frames"),
            frame_digits=max(4, len(str(last_frame))),
        )

    @property
    def rest(self) -> Path:
        """The sublayer with all that does not move, and the rest pose."""
        return self.frame_folder / "rest.usdc"

    @property
    def manifest(self) -> Path:
        """The layer that declares which attributes the frames animate."""
        return self.frame_folder / "manifest.usdc"

    def frame(self, index: int) -> Path:
        """The file of one frame."""
        return self.frame_folder / f"frame.{index:0{self.frame_digits}d}.usdc"

    @property
    def frame_template(self) -> str:
        """The frame files as value clips name them: relative to the root, a ``#`` for each digit."""
        return self.asset_path(self.frame_folder / f"frame.{'#' * self.frame_digits}.usdc", self.root)

    def asset_path(self, file: Path, layer: Path) -> str:
        """Path of a file as a layer names it: relative to the layer, so that the folder can be moved."""
        relative = Path(os.path.relpath(file, layer.parent)).as_posix()
        return relative if relative.startswith("../") else f"./{relative}"

    def publish(self, destination: Path, write: Callable[[Path], object], durable: bool = False) -> None:
        """Have ``write`` fill a file aside, then rename it to ``destination``; a failure leaves nothing.

        Args:
            destination: The file to make or to replace.
            write: Writes all of the file at the path it is given.
            durable: Whether the file must outlast a power cut from here on.

        Raises:
            OutputError: The file cannot be written; what was at ``destination`` is untouched.
        """
        aside = self.frame_folder / f"{_ASIDE}{destination.suffix}"
        try:
            with reported(destination):
                os.stat(self.frame_folder)  # gone in mid-run: USD would make it anew, without what was in it
                write(aside)
                if durable:
                    _flush_to_disk(aside)
                os.replace(aside, destination)
                if durable:
                    _flush_to_disk(destination.parent)
        except BaseException:
            self._remove_matching(f"{_ASIDE}*")
            raise

    def publish_layer(self, destination: Path, layer: Sdf.Layer, durable: bool = False) -> None:
        """Write a layer to ``destination`` as :meth:`publish` does, in the format that the suffix says."""
        self.publish(destination, lambda aside: _export(layer, aside), durable)

    def make_frame_folder(self) -> None:
        """Make the frame folder, and the root's folder where there is none."""
        with reported(self.root.parent):
            self.root.parent.mkdir(parents=True, exist_ok=True)
        with reported(self.frame_folder):
            self.frame_folder.mkdir(exist_ok=True)

    def has_leftovers(self) -> bool:
        """Whether an earlier run that was killed left its frames."""
        return self.frame_folder.is_dir() and any(self.frame_folder.iterdir())

    def remove_frame_folder(self) -> None:
        """Remove what a run puts into the frame folder, and the folder unless it holds a file of others."""
        for pattern in ("frame.*.usdc", self.rest.name, self.manifest.name, f"{_ASIDE}*"):
            self._remove_matching(pattern)
        with contextlib.suppress(OSError):
            self.frame_folder.rmdir()

    def _remove_matching(self, pattern: str) -> None:
        for file in self.frame_folder.glob(pattern):
            with contextlib.suppress(OSError):
                file.unlink()


def _export(layer: Sdf.Layer, file: Path) -> None:
    if not layer.Export(str(file)):
        raise OSError(errno.EIO, os.strerror(errno.EIO))


def _flush_to_disk(path: Path) -> None:
    """Wait until a file's bytes, or a folder's entries, are on the disk."""
    if path.is_dir() and os.name == "nt":
        return  # Windows has no handle of a folder to flush
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
