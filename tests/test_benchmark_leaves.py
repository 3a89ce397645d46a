"""The benchmark of a folder of photos: a row for each, refused ones too, and one sheet of all."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import cv2
import pytest

from benchmarks.leaves import TILE, main


def test_table_and_sheet_of_a_folder(
    photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    for name in ("one.png", "two.png"):
        shutil.copy(photo, folder / name)
    (folder / "broken.png").write_bytes(photo.read_bytes()[:-200])
    (folder / "notes.txt").write_text("not a photo")
    sheet = tmp_path / "sheet.png"
    monkeypatch.setattr(sys, "argv", ["leaves", str(folder), "-o", str(sheet), "--vertices", "120", "--map-size", "24"])
    assert main() == 0
    out = capsys.readouterr().out
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in out.splitlines() if line.startswith("|")]
    assert [row[0] for row in rows[2:]] == ["broken.png", "one.png", "two.png"]
    head = rows[0]
    leaf = dict(zip(head, rows[3], strict=True))
    assert leaf["pixels"] == "200 x 320" and leaf["V - E + F"] == "1"
    assert 0.0 < float(leaf["confidence"]) <= 1.0
    assert abs(int(leaf["vertices"]) - 120) <= 6
    assert all(step in leaf["seconds"] for step in ("read", "segment", "outline", "veins", "maps", "texture", "mesh"))
    assert rows[2][2] == "refused" and "- broken.png: refused: the file is truncated" in out
    assert max(cv2.imread(str(sheet)).shape) > max(TILE)


def test_a_folder_without_photos_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["leaves", str(tmp_path), "-o", str(tmp_path / "sheet.png")])
    assert main() == 2
    assert "no photos" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
