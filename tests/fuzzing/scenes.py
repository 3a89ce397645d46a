"""Damaged and extreme scene files, and odd calls of the command line."""

from __future__ import annotations

import functools
import random
import re
from collections.abc import Callable, Iterator
from typing import Any

from fuzzing.case import OUTPUT, SCENES, Case, damage
from leafwarp.scene import Scene

NAMES = ("blade", "bramble", "cut", "many", "still", "tree")
# What the shipped scenes are cut down to: a case is to take a tenth of a second.
SMALL = (
    (r"vertices = \d+", "vertices = 40"),
    (r"size = (\[\d+, \d+\]|\d{3})", "size = [12, 16]"),
    (r"count = \d+", "count = 2"),
    (r"frames = \d+", "frames = 3"),
    (r"contact_sheet = true", "contact_sheet = false"),
)
VALUES = (
    "0", "-0.0", "1", "-1", "2", "0.5", "1e-9", "1e-320", "1e9", "1e38", "1e39", "1e300", "-1e300", "1e400", "nan",
    "-nan", "inf", "-inf", "2147483648", "-9223372036854775809", "9" * 400, "9" * 5000, "0x" + "f" * 4000, "0b1",
    "1_0", "1__0", "01", "true", "false", "''", '""', '"auto"', '"0"', '" 1 "', '"nan"', '"inf h"', '"1e999 h"',
    '"-5 cm"', '"5 parsec"', '"1 h 5"', '"٣ h"', '"\uff11\uff12 cm"', '"5 µm"', '"50 %"', '"-300 degC"', '"1e400 1/h"',
    '"\\u0000"', '"a\\nb"', '"a\\rb"', '"\\u001b[31m"', '"\\u2028"', '"\\U0010ffff"', '"' + "ä" * 3000 + '"',
    '"../../../etc/passwd"', '"/dev/zero"', '"/dev/null"', '"/proc/self/mem"', '"."', '"/"', '"~"', '"*"',
    '"' + "a/" * 2500 + '"', '"bramble.png"', '"no.png"', "1979-05-27T07:32:00Z", "1979-05-27", "07:32:00", "[]",
    "[[]]", "[0]", "[0, 0]", "[0, 0, 0]", "[nan, 0, 0]", "[1e9, -1e9, 1e9]", "[1e300, 0, 0]", "[1, 2, 3, 4]",
    "[-1e9, -1e9, 1e9, 1e9]", "[[0, 0]]", "[[1, 0], [1, 0.1]]", "[[0, 0], [5e-324, 0.5]]", "[[0.3, -0.5], [1, 0.95]]",
    "[[0, 1], [1e-300, 0], [1, 1]]", "[" + "[0.5, 0.1]," * 65 + "]", "[[[[[[0]]]]]]", "[" * 500 + "]" * 500,
    "[" * 20000, "{}", "{a = 1}", "{a.b.c = {}}", "{" * 100, '"""', "'''a\nb'''",
)  # fmt: skip
LINES = (
    "[fluid]", "[[leaf]]", "[leaf]", "[water]", "[material]", "[stomata]", "[unknown]", "[a.b.c]", "[[fluid]]", "[]",
    "[leaves]", "count = 3", "name = 'x'", "name = 3", 'name = ".."', "fluid.step = 1", "unknown = 1", '"" = 1',
    "'a b' = 1", "\ufeff", "=", "= 1", "a = ", '"\\n" = 1', '"a\\rb" = 1', '"\\u001b[2J" = 1', "\x00", "\x0b", "\u2028",
    "# \x7f", "# ö", "leaf = 3", "time = []", "[leaf.image]", "[time.frames]", "[[leaves.photos]]",
    "[a." + "b." * 3000 + "c]", "[leaves.photos]", "method = 'implicit'", "scheme = 'unsplit'", "precision = 'float64'",
)  # fmt: skip
TOKEN = re.compile(rb"\s+|[\w.+-]+|\"[^\"\n]*\"|.", re.DOTALL)


@functools.cache
def shipped() -> dict[str, str]:
    """The shipped scenes, small."""
    texts = {}
    for name in NAMES:
        text = (SCENES / f"{name}.toml").read_text(encoding="utf-8")
        for pattern, small in SMALL:
            text = re.sub(pattern, small, text)
        texts[name] = text
    return texts


@functools.cache
def keys() -> dict[str, dict[str, Any]]:
    """Every key of a scene, dotted, with its JSON Schema."""
    schema = Scene.model_json_schema()

    def of(table: dict[str, Any], before: str) -> Iterator[tuple[str, dict[str, Any]]]:
        for name, key in table["properties"].items():
            choices = [key, *key.get("anyOf", ())]
            inner = next((c["$ref"].rpartition("/")[2] for c in choices if "$ref" in c), None)
            if inner is None:
                yield before + name, key
            else:
                yield from of(schema["$defs"][inner], f"{before}{name}.")

    return dict(of(schema, ""))


def near_a_bound(schema: dict[str, Any], chance: random.Random) -> str:
    """A value at, just within, just outside of or far from the bounds of a key, as TOML."""
    kinds = [choice for choice in schema.get("anyOf", [schema]) if choice.get("type") != "null"]
    kind = kinds[0] if chance.random() < 0.7 else chance.choice(kinds)
    if "enum" in kind or "const" in kind:
        return f"'{chance.choice(kind.get('enum', [kind.get('const')]))}'"
    if kind.get("type") in ("number", "integer"):
        low = kind.get("minimum", kind.get("exclusiveMinimum", 0.0))
        high = kind.get("maximum", kind.get("exclusiveMaximum", 1e12))
        whole = kind["type"] == "integer"
        inside = (
            low + (high - low) * chance.random(),
            max(low, 1e-12) * (max(high, 1e-9) / max(low, 1e-12)) ** chance.random(),
            (schema.get("default") or 1.0) * 10.0 ** chance.uniform(-3.0, 3.0)
            if isinstance(schema.get("default"), int | float)
            else chance.random(),
        )
        edges = (low, high, low + 1e-9, high * (1.0 - 1e-9), low - 1.0, high * 2.0)
        value = chance.choice(chance.choice((inside, inside, edges)))
        return repr(round(value) if whole else float(value))
    if kind.get("type") == "boolean":
        return chance.choice(("true", "false"))
    if kind.get("type") == "array" and "prefixItems" in kind:
        return f"[{', '.join(near_a_bound(item, chance) for item in kind['prefixItems'])}]"
    if kind.get("type") == "array" and "prefixItems" in kind.get("items", {}):
        count = chance.choice((1, 2, 2, 3, 5, 64))
        return f"[{', '.join(near_a_bound(kind['items'], chance) for _ in range(count))}]"
    return chance.choice(VALUES if chance.random() < 0.3 else ("'cut_source.png'", "'bramble.png'", "'auto'", "0.5"))


def _by_bytes(text: str, chance: random.Random) -> bytes:
    if chance.random() < 0.3:
        return damage(text.encode(), chance, chance.choice((1, 1, 2, 4)))
    characters = list(text)
    for _ in range(chance.choice((1, 1, 2, 3))):
        at = chance.randrange(len(characters))
        characters[at : at + chance.randrange(3)] = chance.choice("0123456789.-+e'\"[]{}=,_#aä \n\t\r")
    return "".join(characters).encode()


def _by_tokens(text: str, chance: random.Random) -> bytes:
    tokens = TOKEN.findall(text.encode())
    others = TOKEN.findall(shipped()[chance.choice(NAMES)].encode())
    for _ in range(chance.choice((1, 1, 2, 4))):
        at = chance.randrange(len(tokens))
        match chance.randrange(5):
            case 0:
                del tokens[at]
            case 1:
                tokens[at] = chance.choice(others)
            case 2:
                tokens.insert(at, chance.choice(others))
            case 3:
                to = chance.randrange(len(tokens))
                tokens[at], tokens[to] = tokens[to], tokens[at]
            case 4:
                tokens[at:at] = [tokens[at]] * chance.choice((1, 2, 50))
    return b"".join(tokens)


def _tables(lines: list[str]) -> list[str]:
    """The table that each line of a scene is in."""
    tables, table = [], ""
    for line in lines:
        heading = re.match(r"\[+(\w+)\]", line)
        table = heading[1] if heading else table
        tables.append(table)
    return tables


def _by_values(text: str, chance: random.Random) -> bytes:
    lines = text.splitlines()
    tables = _tables(lines)
    places = [place for place, line in enumerate(lines) if re.match(r"\w+ = ", line)]
    for place in chance.sample(places, chance.choice((1, 1, 2, 3))):
        key = lines[place].partition(" = ")[0]
        value = (
            near_a_bound(keys()[f"{tables[place]}.{key}"], chance) if chance.random() < 0.7 else chance.choice(VALUES)
        )
        lines[place] = f"{key} = {value}"
    return "\n".join(lines).encode()


def _by_lines(text: str, chance: random.Random) -> bytes:
    lines = text.splitlines()
    for _ in range(chance.choice((1, 1, 2, 4))):
        at = chance.randrange(len(lines))
        match chance.randrange(8):
            case 0 | 1:
                del lines[at]
            case 2:
                lines.insert(at, lines[chance.randrange(len(lines))])
            case 3:
                lines.insert(at, chance.choice(LINES))
            case 4:
                lines[at:] = chance.choice((shipped()[chance.choice(NAMES)].splitlines()[at:], [chance.choice(LINES)]))
            case _:
                own = [key for key in keys() if key.partition(".")[0] == _tables(lines)[at]] or list(keys())
                key = chance.choice(own)
                lines.insert(at + 1, f"{key.rpartition('.')[2]} = {near_a_bound(keys()[key], chance)}")
    data = chance.choice(("\n", "\n", "\n", "\n", "\r\n", "\r")).join(lines).encode()
    if chance.random() < 0.9:
        return data
    return chance.choice((data[: chance.randrange(len(data) + 1)], b"\xef\xbb\xbf" + data, data * 2))


def _changes(text: str, chance: random.Random) -> list[str]:
    """Options that set keys, most of tables that the scene has, to values near their bounds."""
    tables = set(_tables(text.splitlines())) | {"structure", "motion", "solver", "output", "maps", "mesh"}
    own = [key for key in keys() if key.partition(".")[0] in tables]
    arguments = []
    for _ in range(chance.choice((1, 1, 2, 3, 6))):
        key = chance.choice(own if chance.random() < 0.9 else list(keys()))
        arguments += ["--set", f"{key}={near_a_bound(keys()[key], chance)}"]
    return arguments


def _odd_call(chance: random.Random) -> list[str]:
    """A verb with options as no user would write them, most of them of the verb."""
    odd_keys = (
        "",
        ".",
        "..",
        "leaf",
        "leaf.",
        ".leaf",
        "leaf.image.x",
        "a.b",
        "leaf.length",
        "ä",
        "time.frames.x",
        "\n",
    )
    outputs = ("", "a.usd", "a.usda", "a.USDC", "a.usdz", "a.png", "a b", "ä", "\udcff", "a\nb", "a\\b", "x" * 300,
               "..a", ".", "a.b.usd", "%s", "$HOME", "a/" * 200, "{}", "@a", "a:b", "[a].usd", ".usd",
               "\x1b[2J")  # fmt: skip
    tables = ("", "=", "a", "a=", "=a", "leaf=[]", "leaf=[1]", "leaf={}", "time={}", "leaves.photos=[1]", "fluid={}")
    devices = ("cpu", "cuda", "cuda:0", "cuda:99", "cpu:0", "", "gpu", "ä", "cuda:" + "9" * 30)
    frames = ("1", "0", "1:2", "2:1", "2:3", "3", ":", "1:", "a", "1:1e9", "-1", "\uff19", "9" * 5000, "1:2:3")
    sets = [("--set", f"{chance.choice(odd_keys)}={chance.choice(VALUES)}"), ("--set", chance.choice(tables))]
    device = ("--device", chance.choice(devices))
    output = ("-o", f"../{OUTPUT}/{chance.choice(outputs)}")
    of_verbs = {
        "run": [*sets, device, output, output, output, ("-f", chance.choice(frames)), ("--maps",), ("--json",)],
        "plan": [*sets, device, ("--json",)],
        "new": [output, output, ("--maps",), ("--length", chance.choice(VALUES))],
        "schema": [(chance.choice(("extra", "", "\udcff", "-", "--", "--wrong")),)],
    }
    verb = chance.choice((*of_verbs, "run", "run", "run", "run", "plan", "plan", "plan", "plan", "plan", "schema"))
    call = {
        "run": ["run", "scene.toml", "-q", "--overwrite", "-o", f"../{OUTPUT}"],
        "plan": ["plan", "scene.toml"],
        "new": ["new", "bramble.png", "-o", f"../{OUTPUT}/a.toml"],
        "schema": ["schema"],
    }[verb]
    for _ in range(chance.choice((1, 1, 2))):
        call += chance.choice(of_verbs[verb if chance.random() < 0.9 else chance.choice(tuple(of_verbs))])
    return call


KINDS: dict[str, Callable[[str, random.Random], bytes]] = {
    "scene: bytes": _by_bytes,
    "scene: tokens": _by_tokens,
    "scene: values": _by_values,
    "scene: lines": _by_lines,
}
ROWS = (*KINDS, "scene: --set near bounds", "command line")


def scene_case(chance: random.Random) -> Case:
    """A random case of a damaged or extreme scene."""
    kind = chance.choice(ROWS)
    name = chance.choice(NAMES)
    text = shipped()[name]
    verb = chance.choice(("plan", "plan", "plan", "run"))
    options = {"plan": [], "run": ["-q", "--overwrite", "-o", f"../{OUTPUT}"]}[verb]
    if kind in KINDS:
        return Case(kind, (verb, "scene.toml", *options), {"scene.toml": KINDS[kind](text, chance)})
    if kind == "command line":
        return Case(kind, tuple(_odd_call(chance)), {"scene.toml": text.encode()})
    return Case(kind, (verb, "scene.toml", *options, *_changes(text, chance)), {"scene.toml": text.encode()})
