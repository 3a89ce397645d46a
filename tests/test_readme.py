"""The README against the project: its commands, its picture, its scene reference, its index."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from leafwarp.cli import make_parser
from leafwarp.scene import Scene

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_ci_runs_the_readmes_test_command() -> None:
    command = next(line for line in README.splitlines() if line.endswith("-m pytest -n auto"))
    assert command in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


def test_its_picture_and_scenes_are_there() -> None:
    for path in re.findall(r"\]\((?!http)([^)]+)\)", README) + re.findall(r"run (scenes/\w+\.toml)", README):
        assert (ROOT / path).is_file(), path


TABLES = [name for name in Scene.model_fields if f"{name.capitalize()}Table" in Scene.model_json_schema()["$defs"]]


@pytest.mark.parametrize("table", TABLES)
def test_every_key_of_a_scene_is_in_its_reference(table: str) -> None:
    row = next(line for line in README.splitlines() if line.startswith(f"| `[{table}]`"))
    keys = Scene.model_json_schema()["$defs"][f"{table.capitalize()}Table"]["properties"]
    for key in keys:
        assert f"`{key}`" in row, key


def test_every_key_outside_tables_is_in_its_reference() -> None:
    row = next(line for line in README.splitlines() if line.startswith("| before the first table |"))
    for key in set(Scene.model_fields) - set(TABLES):
        assert f"`{key}`" in row, key


def test_every_verb_is_listed() -> None:
    verbs = next(a for a in make_parser()._actions if a.dest == "verb").choices
    for verb in verbs:
        assert re.search(rf"^\| `{verb}\b", README, re.MULTILINE), verb


def test_every_place_of_its_index_exists() -> None:
    index = README[README.index("## Where to find things") :]
    for name in re.findall(r"`([\w./*]+(?:\.py|/))`", index):
        places = (".", "kernels/leafwarp_kernels", "leafwarp/sim/fluid", "leafwarp/sim")
        assert any(list((ROOT / place).glob(name.rstrip("/"))) for place in places), name
