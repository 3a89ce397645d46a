"""Damaged pictures, and whole ones of adverse sizes, depths and contents."""

from __future__ import annotations

import functools
import random
import struct
from collections.abc import Callable

import cv2
import numpy as np

from fuzzing.case import OUTPUT, Case, damage
from image_bytes import cmyk_jpeg, declared, encode, jpeg_segments, png_chunk

SUFFIXES = (".png", ".jpg", ".tiff", ".webp")
TIFF_COMPRESSIONS = (1, 5, 8, 32773)  # none, LZW, deflate, PackBits
SIZE = (72, 56)  # [pixels] height and width of the drawn leaf
EDGES = (0, 1, 2, 31, 32, 33, 255, 256, 65535, 65536, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
SCENE = """
[leaf]
image = "{photo}"
length = "8 cm"
{mask}
[mesh]
vertices = 40
[maps]
size = [12, 16]
{map}
[time]
duration = "2 h"
frames = 2
[structure]
membrane_stiffness = 6.0
"""
# What needs a map, and no other one, which would take time.
TABLES = {
    "venation": "[fluid]",
    "stomata": "[fluid]\nlamina_diffusivity = 0\nvein_diffusivity = 0\n[transpiration]\nrate = 1e-5",
    "water": "[fluid]\nlamina_diffusivity = 0\nvein_diffusivity = 0",
    "source": "[fluid]\nlamina_diffusivity = 0\nvein_diffusivity = 0\n[source]\nconductance = 1e-3",
}


@functools.cache
def drawn(height: int = SIZE[0], width: int = SIZE[1]) -> np.ndarray:
    """A green leaf with a petiole and a midrib on light paper, 8-bit RGB."""
    picture = np.full((height, width, 3), 236, np.uint8)
    centre, axes = (width // 2, 2 * height // 5), (max(1, width // 3), max(1, height // 3))
    cv2.ellipse(picture, centre, axes, 0, 0, 360, (60, 130, 50), -1, cv2.LINE_AA)
    cv2.line(picture, (width // 2, height // 2), (width // 2, 9 * height // 10), (70, 130, 60), 3)
    cv2.line(picture, (width // 2, height // 8), (width // 2, 8 * height // 10), (150, 190, 120), 1)
    return picture


@functools.cache
def base(suffix: str, option: int = 0) -> bytes:
    """A whole picture of the leaf in a format."""
    options = (cv2.IMWRITE_TIFF_COMPRESSION, TIFF_COMPRESSIONS[option]) if suffix == ".tiff" else ()
    if suffix == ".jpg" and option % 2:
        options = (cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
    return encode(suffix, drawn(), *options)


def _any_base(suffix: str, chance: random.Random) -> bytes:
    return base(suffix, chance.randrange(4) if suffix in (".tiff", ".jpg") else 0)


def png_chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    """Kind and content of each chunk of a PNG."""
    chunks, position = [], 8
    while position < len(data):
        length, kind = struct.unpack_from(">I4s", data, position)
        chunks.append((kind, data[position + 8 : position + 8 + length]))
        position += 12 + length
    return chunks


def _by_bytes(suffix: str, chance: random.Random) -> bytes:
    return damage(_any_base(suffix, chance), chance, chance.choice((1, 1, 2, 4, 16)))


def _by_cuts(suffix: str, chance: random.Random) -> bytes:
    data = _any_base(suffix, chance)
    cut = data[: chance.choice((0, 1, 2, 3, 4, 8, 12, 16, 33, chance.randrange(len(data)), len(data) - 1))]
    return chance.choice((cut, cut, cut + b"\xff\xd9", cut + bytes(100), data + data, bytes(8) + data, data + bytes(9)))


def _by_header(suffix: str, chance: random.Random) -> bytes:
    """Other numbers in the first bytes, or a declared size that is not that of the pixels."""
    if chance.random() < 0.4:
        sizes = (1, 2, 31, 32, 40, 41, 1000, 12_000, 20_000, 65_535)
        return declared(suffix, chance.choice(sizes), chance.choice(sizes))
    data = bytearray(_any_base(suffix, chance))
    for _ in range(chance.choice((1, 2, 4))):
        form = chance.choice(("B", ">H", "<H", ">I", "<I"))
        at = chance.randrange(min(len(data) - 4, 64 if chance.random() < 0.7 else 700))
        struct.pack_into(form, data, at, chance.choice(EDGES) % 256 ** struct.calcsize(form))
    return bytes(data)


def _by_parts(suffix: str, chance: random.Random) -> bytes:
    """The format's own parts removed, doubled, moved, emptied or damaged, with lengths and checksums that fit."""
    data = _any_base(suffix, chance)
    if suffix == ".png":
        head, parts = data[:8], png_chunks(data)
        extra = [(b"tRNS", bytes(6)), (b"PLTE", bytes(chance.choice((3, 5, 768, 900)))), (b"eXIf", base(".tiff")[:200]),
                 (b"acTL", bytes(8)), (b"iCCP", b"x\0\0" + bytes(50)), (b"gAMA", bytes(4)), (b"tEXt", bytes(99999)),
                 (b"IDAT", b""), (b"\0\xff\0\0", b"?"), (b"IHDR", parts[0][1]), (b"sBIT", b"\xff" * 3)]  # fmt: skip
    elif suffix == ".jpg":
        head, parts = data[:2], [(bytes([marker]), content[2:]) for marker, content in jpeg_segments(data)]
        exif = b"Exif\0\0" + exif_block(chance.choice((0, 1, 3, 6, 8, 9, 65535)))
        extra = [(b"\xe1", exif), (b"\xe1", exif[: chance.randrange(len(exif))]), (b"\xee", b"Adobe" + bytes(7)),
                 (b"\xdd", bytes(2)), (b"\xfe", bytes(65533)), (b"\xc0", bytes(15)), (b"\xdb", bytes(65))]  # fmt: skip
    else:
        return _by_header(suffix, chance)
    for _ in range(chance.choice((1, 1, 2, 3))):
        at = chance.randrange(len(parts))
        match chance.randrange(5):
            case 0:
                del parts[at]
            case 1:
                parts.insert(at, parts[chance.randrange(len(parts))])
            case 2:
                parts.insert(at, chance.choice(extra))
            case 3:
                parts[at] = (parts[at][0], damage(parts[at][1], chance, chance.choice((1, 2, 8))))
            case 4:
                parts[at] = (parts[at][0], parts[at][1][: chance.randrange(len(parts[at][1]) + 1)])
        if not parts:
            break
    if suffix == ".png":
        return head + b"".join(png_chunk(*part) for part in parts)
    segments = (b"\xff" + kind + struct.pack(">H", min(len(rest) + 2, 65535)) + rest for kind, rest in parts)
    return head + b"".join(segments) + b"\xff\xd9"


def exif_block(orientation: int) -> bytes:
    """An EXIF block that holds an orientation alone."""
    return b"II*\0" + struct.pack("<IHHHIHHI", 8, 1, 274, 3, 1, orientation, 0, 0)


def _with_orientation(suffix: str, data: bytes, orientation: int) -> bytes:
    if suffix == ".png":
        return data[:33] + png_chunk(b"eXIf", exif_block(orientation)) + data[33:]
    if suffix == ".jpg":
        block = b"Exif\0\0" + exif_block(orientation)
        return data[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + data[2:]
    return data


def _animated_png() -> bytes:
    data = base(".png")
    return data[:33] + png_chunk(b"acTL", struct.pack(">II", 2, 0)) + data[33:]


def _size(chance: random.Random) -> tuple[int, int]:
    """Height and width [pixels], most small, some at what is accepted or beyond it."""
    sides = (1, 2, 31, 32, 33, 40, 64, 64, 72, 96, 96, 100, 128, 257)
    sizes = [(chance.choice(sides), chance.choice(sides))] * 50
    return chance.choice([*sizes, (32, 65_535), (65_535, 32), (1, 65_535), (40_000, 1), (600, 900), (9_000, 9_000)])


def _contents(height: int, width: int, chance: random.Random) -> np.ndarray:
    """RGB pixels: a leaf, several, noise, stripes, one colour, and leaves that touch or fill the picture."""
    noise = np.random.default_rng(chance.randrange(2**32))
    if height * width > 1_000_000:
        return np.zeros((height, width, 3), np.uint8)
    leaf = drawn(height, width)
    match chance.randrange(11):
        case 0:
            return np.full((height, width, 3), chance.choice((0, 128, 255)), np.uint8)
        case 1:
            return noise.integers(0, 256, (height, width, 3), np.uint8)
        case 2:
            stripes = np.arange(width) // chance.choice((1, 2, 7)) % 2
            return np.broadcast_to(np.where(stripes, 250, 40).astype(np.uint8)[None, :, None], leaf.shape).copy()
        case 3:
            return np.tile(leaf, (2, 3, 1))[:4000, :4000]
        case 4:
            return np.roll(leaf, (height // 2, width // 2), (0, 1))
        case 5:
            return np.clip(leaf + noise.normal(0.0, chance.choice((5, 40, 120)), leaf.shape), 0, 255).astype(np.uint8)
        case 6:
            return leaf[
                height // 4 : max(height // 4 + 1, 3 * height // 4), width // 4 : max(width // 4 + 1, 3 * width // 4)
            ]
        case 7:
            return leaf[..., list(chance.choice(((0, 0, 0), (2, 0, 1), (1, 1, 0))))]
        case 8:
            holes = leaf.copy()
            holes[:: chance.choice((2, 3, 9)), :: chance.choice((2, 3, 9))] = 236
            return holes
        case _:
            return leaf


def _by_contents(suffix: str, chance: random.Random) -> bytes:
    """A whole picture of any size, depth, number of channels and orientation."""
    if chance.random() < 0.08:
        small = _contents(chance.choice((8, 40, 96)), chance.choice((8, 40, 72)), chance)
        return chance.choice((
            cmyk_jpeg(np.dstack([255 - small, np.zeros(small.shape[:2], np.uint8)])),
            _animated_png(),
        ))  # fmt: skip
    pixels = _contents(*_size(chance), chance)
    height, width = pixels.shape[:2]
    if suffix == ".webp" and max(height, width) > 16_383:
        pixels = pixels[:16_383, :16_383]
    if suffix == ".jpg" and max(height, width) > 65_500:
        pixels = pixels[:65_500, :65_500]
    depth = chance.choice(("colour", "colour", "grey", "alpha", "16 bit", "16 bit alpha", "float"))
    if depth == "grey" and suffix != ".webp":
        pixels = pixels[..., 1].copy()
    elif "alpha" in depth and suffix != ".jpg":
        opaque = (pixels[..., 2] < 200) * np.uint8(255)
        opaque = chance.choice((opaque, 255 - opaque, opaque * 0, opaque | 255, pixels[..., 0]))
        pixels = np.dstack([pixels, opaque])
    if "16 bit" in depth and suffix in (".png", ".tiff"):
        pixels = pixels.astype(np.uint16) * chance.choice((1, 16, 257))
    elif depth == "float" and suffix == ".tiff":
        pixels = pixels.astype(np.float32) / np.float32(chance.choice((255.0, 1.0, 1e-35, np.nan)))
    data = encode(suffix, pixels)
    return (
        _with_orientation(suffix, data, chance.choice((0, 1, 2, 3, 4, 5, 6, 7, 8, 9)))
        if chance.random() < 0.3
        else data
    )


KINDS: dict[str, Callable[[str, random.Random], bytes]] = {
    "picture: bytes": _by_bytes,
    "picture: cuts": _by_cuts,
    "picture: header": _by_header,
    "picture: parts": _by_parts,
    "picture: contents": _by_contents,
}


def image_case(chance: random.Random) -> Case:
    """A random case of a damaged or adverse picture: the photo of `new` or of a scene, a mask or a map."""
    kind = chance.choice(tuple(KINDS))
    suffix = chance.choice(SUFFIXES)
    name = f"picture{chance.choice((suffix, suffix, suffix, *SUFFIXES, '.jpeg', '.gif', ''))}"
    files = {name: KINDS[kind](suffix, chance)}
    use = chance.choice(("new", "new", "photo", "mask", "venation", "stomata", "water", "source"))
    if use == "new":
        maps = chance.choice(([], [], ["--maps"]))
        return Case(kind, ("new", name, "-o", f"../{OUTPUT}/new.toml", *maps), files)
    if use != "photo":
        files["drawn.png"] = base(".png")
    scene = SCENE.format(
        photo=name if use == "photo" else "drawn.png",
        mask=f'mask = "{name}"' if use == "mask" else "",
        map=f'{use} = "{name}"' if use in TABLES else "",
    )
    scene += TABLES.get(use, "[water]\ncurve = [[0, 1]]")
    return Case(kind, ("plan", "scene.toml"), {**files, "scene.toml": scene.encode()})
