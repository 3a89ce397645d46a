"""Scene files: reading one, and saying in plain words what is wrong with it."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from leafwarp.errors import InputError
from leafwarp.scene import Scene, put_value
from leafwarp.scene.fields import Table
from leafwarp.scene.quality import DECIDED


def parse_scene(data: Mapping[str, Any], where: str, folder: Path) -> Scene:
    """Validate a scene given as nested tables.

    Args:
        data: Tables and keys as in a scene file.
        where: What error messages call the scene, usually its file name.
        folder: Folder that image paths are relative to.

    Raises:
        InputError: With key, value and what is accepted.
    """
    scene = Scene.checked(data, where)
    absolute = {
        f"{table}.{key}": folder / value
        for table in ("leaf", "maps")
        for key, value in getattr(scene, table)
        if isinstance(value, Path)
    }
    if scene.leaves is not None and scene.leaves.photos:
        absolute["leaves.photos"] = [_with_absolute_paths(photo, folder) for photo in scene.leaves.photos]
    return scene.with_changes(absolute)


def _with_absolute_paths(photo: Table, folder: Path) -> dict[str, Any]:
    values = photo.model_dump(exclude_unset=True)
    return {key: folder / value if isinstance(value, Path) else value for key, value in values.items()}


def _make_way(data: dict[str, Any], changed: Mapping[str, Any]) -> None:
    """Take away what a quality or a tolerance of the command line decides, where that does not say it itself."""
    for asked, other in (("quality", "tolerance"), ("tolerance", "quality")):
        if asked in changed:
            data.pop(other, None)
            for key in DECIDED:
                table, _, name = key.partition(".")
                if isinstance(data.get(table), dict):
                    data[table].pop(name, None)


def load_scene(path: Path, changes: Sequence[str] = ()) -> Scene:
    """Read a scene file.

    Args:
        path: A TOML file.
        changes: Overrides "key=value" as on the command line; the value is TOML, or else a plain string. A quality or
            a tolerance among them also overrides the keys of the file that it decides.

    Raises:
        InputError: No such file, not TOML, or not a valid scene.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such scene file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a text file: {error}") from None
    except RecursionError:
        raise InputError(f"{path}: not valid TOML: lists or tables are nested too deeply") from None
    except ValueError as error:  # a number of thousands of digits, too
        raise InputError(f"{path}: not valid TOML: {error}") from None
    changed: dict[str, Any] = {}
    for change in changes:
        key, separator, text = change.partition("=")
        if not separator or not key.strip():
            raise InputError(f"--set {change}: accepted: key=value, such as fluid.step=30")
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except (ValueError, RecursionError):
            value = text.strip()
        changed[key.strip()] = value
    _make_way(data, changed)
    for key, value in changed.items():
        put_value(data, key, value, "--set ")
    data.setdefault("name", re.sub(r"[^A-Za-z0-9_.-]+", "_", path.stem))
    return parse_scene(data, str(path), path.parent)
