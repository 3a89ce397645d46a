"""Files that are written whole or not at all."""

from __future__ import annotations

import contextlib
from pathlib import Path

from leafwarp.errors import InputError, OutputError


def check_result(path: Path, overwrite: bool) -> None:
    """See that a result may be written to a file.

    Args:
        path: The file.
        overwrite: Whether what is there already may be replaced.

    Raises:
        InputError: It is there already, is a folder, or no file can have that name.
    """
    try:
        str(path).encode()
        is_folder, is_there = path.is_dir(), path.exists()
    except UnicodeEncodeError:
        raise InputError(f"{path}: is a name that is not UTF-8; choose another -o") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}; choose another -o") from None
    if is_folder:
        raise InputError(f"{path}: is a folder where a result is to be written")
    if is_there and not overwrite:
        raise InputError(f"{path}: exists already; --overwrite replaces it")


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file by way of a temporary one beside it.

    Raises:
        OutputError: It cannot be written; what was there before is still there.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None


def write_text(path: Path, text: str) -> None:
    """As :func:`write_bytes`, for text."""
    write_bytes(path, text.encode())


def texture_path(usd: Path, index: int) -> Path:
    """Where the texture of a photo lies, beside the USD."""
    number = "" if index == 0 else f"_{index + 1}"
    return usd.with_name(f"{usd.stem}_texture{number}.png")
