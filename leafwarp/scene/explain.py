"""What a validator finds wrong with a scene, in plain words and with the keys of the scene file."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError

LONGEST_QUOTE = 60  # characters of a value
# Where the validator speaks of Python, a scene's author reads of TOML.
_PLAIN_WORDS = {
    "model_type": "a table is wanted",
    "tuple_type": "a list is wanted",
    "path_type": "a file's path is wanted",
    "string_type": "a string is wanted",
    "float_type": "a number is wanted",
    "int_type": "a whole number is wanted",
    "bool_type": "accepted: true or false",
    "string_pattern_mismatch": "accepted: letters, digits, '_', '.' and '-'",
}


def explain(error: ValidationError, scene: type[BaseModel]) -> str:
    """One line for the first error: key, value, what is accepted (by any alternative of the key's type).

    Args:
        error: What the validator found.
        scene: The model of a whole scene.
    """
    errors = error.errors()
    more = len({e["loc"][:2] for e in errors}) - 1
    return _first(errors, scene) + (f" (and {more} more)" if more > 0 else "")


def _first(errors: Sequence[Mapping[str, Any]], scene: type[BaseModel]) -> str:
    first = errors[0]
    location, value = first["loc"], first.get("input")
    table = _model_at(location[:-1], scene) if location else scene
    if first["type"] == "extra_forbidden":
        known = list(table.model_fields)
        near = difflib.get_close_matches(str(location[-1]), known, n=1, cutoff=0.5)
        hint = f"did you mean '{near[0]}'?" if near else f"known keys here: {', '.join(known)}"
        return f"{'.'.join(map(str, location))}: unknown key; {hint}"
    key = _key_of(location, scene)
    if first["type"] == "missing" and isinstance(location[-1], int):
        absent = sum(e["type"] == "missing" and e["loc"][:-1] == location[:-1] for e in errors)
        wanted = f"accepted: a list of {len(value) + absent}, not of {len(value)}"
        return f"{_key_of(location[:-1], scene)} = {_quoted(value)}: {wanted}"
    if first["type"] == "missing":
        field = table.model_fields.get(str(location[-1]))
        return f"{key}: missing; {(field and field.description) or 'this key is required'}"
    alternatives = [_plain_words(e) for e in errors if _key_of(e["loc"], scene) == key]
    message = ", or ".join(dict.fromkeys(text[0].lower() + text[1:] for text in alternatives))
    message = message.replace(", or accepted: ", ", or ")
    quoted = "" if isinstance(value, (dict, BaseModel)) else f" = {_quoted(value)}"
    return f"{key}{quoted}: {message}" if key else message


def _plain_words(error: Mapping[str, Any]) -> str:
    limits = error.get("ctx", {})
    if error["type"] == "too_short":
        return f"accepted: a list of at least {limits['min_length']}, not of {limits['actual_length']}"
    if error["type"] == "too_long":
        return f"accepted: a list of at most {limits['max_length']}, not of {limits['actual_length']}"
    if error["type"] == "literal_error":
        return f"accepted: {limits['expected']}"
    return _PLAIN_WORDS.get(error["type"], error["msg"].removeprefix("Value error, "))


def _quoted(value: Any) -> str:
    try:
        text = repr(value)
    except ValueError:  # Python prints whole numbers of up to 4300 digits
        return "a number of thousands of digits"
    return text if len(text) <= LONGEST_QUOTE else f"{text[:LONGEST_QUOTE]}..."


def _model_at(location: Sequence[Any], scene: type[BaseModel]) -> type[BaseModel]:
    """The table that a location of a validation error lies in."""
    model = scene
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


def _key_of(location: Sequence[Any], scene: type[BaseModel]) -> str:
    """The dotted key of an error, without the steps that only say which alternative of a type was tried."""
    model: type[BaseModel] | None = scene
    key: list[str] = []
    for name in location:
        if isinstance(name, int) and key:
            key[-1] += f"[{name}]"
        elif model is not None and name in model.model_fields:
            key.append(name)
            table = _model_at(key, scene)
            model = table if table is not model else None
    return ".".join(key)
