"""Scene files: reading one, and saying in plain words what is wrong with it."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from leafwarp.errors import InputError
from leafwarp.scene import Scene, put_value


def _model_at(location: Sequence[Any]) -> type[BaseModel]:
    """The table that a location of a validation error lies in."""
    model: type[BaseModel] = Scene
    for name in location:
        if not isinstance(name, str) or name not in model.model_fields:
            break
        annotation = model.model_fields[name].annotation
        inner = [a for a in (annotation, *getattr(annotation, "__args__", ())) if isinstance(a, type)]
        table = next((a for a in inner if issubclass(a, BaseModel)), None)
        if table is None:
            break
        model = table
    return model


def _key_of(location: Sequence[Any]) -> str:
    """The dotted key of an error, without the steps that only say which alternative of a type was tried."""
    model: type[BaseModel] | None = Scene
    key: list[str] = []
    for name in location:
        if isinstance(name, int) and key:
            key[-1] += f"[{name}]"
        elif model is not None and name in model.model_fields:
            key.append(name)
            table = _model_at(key)
            model = table if table is not model else None
    return ".".join(key)


# Where the validator speaks of Python, a scene's author reads of TOML.
_PLAIN_WORDS = {
    "model_type": "a table is wanted",
    "tuple_type": "a list is wanted",
    "path_type": "a file's path is wanted",
    "string_type": "a string is wanted",
    "float_type": "a number is wanted",
    "int_type": "a whole number is wanted",
    "string_pattern_mismatch": "accepted: letters, digits, '_', '.' and '-'",
}


def _explain(errors: Sequence[Mapping[str, Any]]) -> str:
    """One line for the first error: key, value, what is accepted (by any alternative of the key's type)."""
    error = errors[0]
    location = error["loc"]
    table = _model_at(location[:-1]) if location else Scene
    if error["type"] == "extra_forbidden":
        known = list(table.model_fields)
        near = difflib.get_close_matches(str(location[-1]), known, n=1, cutoff=0.5)
        hint = f"did you mean '{near[0]}'?" if near else f"known keys here: {', '.join(known)}"
        return f"{'.'.join(map(str, location))}: unknown key; {hint}"
    key = _key_of(location)
    if error["type"] == "missing":
        return f"{key}: missing; {_description(location) or 'this key is required'}"
    same_key = [e for e in errors if _key_of(e["loc"]) == key]
    alternatives = [_PLAIN_WORDS.get(e["type"], e["msg"].removeprefix("Value error, ")) for e in same_key]
    message = ", or ".join(dict.fromkeys(text[0].lower() + text[1:] for text in alternatives))
    value = error.get("input")
    quoted = "" if isinstance(value, (dict, BaseModel)) else f" = {value!r}"
    return f"{key}{quoted}: {message}" if key else message


def _description(location: Sequence[Any]) -> str:
    table = _model_at(location[:-1])
    field = table.model_fields.get(str(location[-1]))
    return (field.description or "") if field else ""


def parse_scene(data: Mapping[str, Any], where: str, folder: Path) -> Scene:
    """Validate a scene given as nested tables.

    Args:
        data: Tables and keys as in a scene file.
        where: What error messages call the scene, usually its file name.
        folder: Folder that image paths are relative to.

    Raises:
        InputError: With key, value and what is accepted.
    """
    try:
        scene = Scene.model_validate(data)
    except ValidationError as error:
        errors = error.errors()
        more = len({e["loc"][:2] for e in errors}) - 1
        tail = f" (and {more} more)" if more > 0 else ""
        raise InputError(f"{where}: {_explain(errors)}{tail}") from None
    absolute = {
        f"{table}.{key}": folder / value
        for table in ("leaf", "maps")
        for key, value in getattr(scene, table)
        if isinstance(value, Path)
    }
    return scene.with_changes(absolute)


def load_scene(path: Path, changes: Sequence[str] = ()) -> Scene:
    """Read a scene file.

    Args:
        path: A TOML file.
        changes: Overrides "key=value" as on the command line; the value is TOML, or else a plain string.

    Raises:
        InputError: No such file, not TOML, or not a valid scene.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such scene file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a text file: {error}") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    for change in changes:
        key, separator, text = change.partition("=")
        if not separator or not key.strip():
            raise InputError(f"--set {change}: accepted: key=value, such as fluid.step=30")
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            value = text.strip()
        put_value(data, key.strip(), value)
    data.setdefault("name", re.sub(r"[^A-Za-z0-9_.-]+", "_", path.stem))
    return parse_scene(data, str(path), path.parent)
