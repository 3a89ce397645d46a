"""Prepared leaves on disk, found again by the content of everything that they were made from."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from pathlib import Path

import numpy as np

from leafwarp.leaf.leaf import Findings, Leaf, MapFrame
from leafwarp.leaf.mesh.topology import mesh_from_triangles

_PLAIN_FINDINGS = ("base", "photo_size", "base_found", "pixel", "confidence", "notes", "vein_kind")
_MESH_ARRAYS = ("positions", "triangles")


def content_key(arguments: object, files: list[bytes]) -> str:
    """Hexadecimal key of some arguments (by their repr), some files' bytes and the source of this package."""
    digest = hashlib.blake2b(digest_size=16)
    sources = [source.read_bytes() for source in sorted(Path(__file__).parent.rglob("*.py"))]
    for part in (repr(arguments).encode(), *files, *sources):
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()


def load_leaf(path: Path) -> Leaf | None:
    """The leaf stored in a file, or None where there is none or the file is damaged."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            # Checks the sheet, so that a damaged file is never simulated.
            mesh = mesh_from_triangles(stored["positions"], stored["triangles"], holes=None)
            origin, size = stored["frame"].tolist()
            maps = {name.removeprefix("map_"): stored[name] for name in stored.files if name.startswith("map_")}
            return Leaf(
                mesh=mesh,
                frame=MapFrame(tuple(origin), tuple(size)),
                length=float(stored["length"]),
                texture=stored["texture"],
                mask=stored["mask"] if "mask" in stored.files else None,
                maps=maps,
                findings=_read_findings(stored),
                fine_venation=stored["fine_venation"] if "fine_venation" in stored.files else None,
            )
    except Exception:  # a damaged archive fails in many ways, each with its own type; the leaf is then made anew
        return None


def store_leaf(path: Path, leaf: Leaf) -> None:
    """Write a leaf by temporary file and rename, so that a reader never meets half of it.

    A folder that cannot be written is no error: the leaf is then made anew next time.
    """
    arrays = {name: getattr(leaf.mesh, name) for name in _MESH_ARRAYS}
    arrays |= {f"map_{name}": values for name, values in leaf.maps.items()}
    arrays |= {"frame": np.array([leaf.frame.origin, leaf.frame.size]), "length": np.array(leaf.length)}
    arrays["texture"] = leaf.texture
    for name in ("mask", "fine_venation"):
        if getattr(leaf, name) is not None:
            arrays[name] = getattr(leaf, name)
    if leaf.findings is not None:
        arrays |= _findings_arrays(leaf.findings)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(temporary, "wb") as stream:
            np.savez(stream, **arrays)
        os.replace(temporary, path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def _findings_arrays(findings: Findings) -> dict[str, np.ndarray]:
    plain = {name: getattr(findings, name) for name in _PLAIN_FINDINGS} | {"steps": list(findings.seconds)}
    points = [points for points, _ in findings.veins]
    return {
        "findings": np.array(json.dumps(plain)),
        "outline": findings.outline,
        "seconds": np.array(list(findings.seconds.values()), float),
        "vein_lengths": np.array([len(line) for line in points], np.int64),
        "vein_points": np.concatenate(points) if points else np.zeros((0, 2)),
        "vein_flow": np.concatenate([flow for _, flow in findings.veins]) if points else np.zeros(0),
    }


def _read_findings(stored: np.lib.npyio.NpzFile) -> Findings | None:
    if "findings" not in stored.files:
        return None
    plain = json.loads(str(stored["findings"]))
    plain |= {name: tuple(plain[name]) for name in ("base", "photo_size", "notes")}
    plain["seconds"] = dict(zip(plain.pop("steps"), stored["seconds"].tolist(), strict=True))
    ends = np.cumsum(stored["vein_lengths"])[:-1]
    veins = zip(np.split(stored["vein_points"], ends), np.split(stored["vein_flow"], ends), strict=True)
    return Findings(outline=stored["outline"], veins=tuple(veins) if len(stored["vein_lengths"]) else (), **plain)
