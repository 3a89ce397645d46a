"""What is asked of a leaf's preparation, checked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from leafwarp.errors import InputError

MAP_NAMES = ("venation", "stomata", "water", "source")
VEIN_KINDS = ("photo", "pinnate", "palmate", "parallel")
MOST_CELLS = 8192


@dataclass(frozen=True)
class LeafRequest:
    """How to turn a photo into a leaf.

    Attributes:
        image: PNG, JPEG, TIFF or WebP picture of a leaf; opacity is honoured as its mask.
        length: Distance from the petiole base to the farthest point of the leaf [m]; it sets the scale.
        pixels_per_metre: Scale of the photo, where no length is given.
        mask: Picture of the same frame (any size), light on the leaf, that replaces the search for it.
        rect: Left, top, width and height [pixels of the upright photo] of the part in which to look for the leaf.
        base: The petiole's end in pixels of the upright photo, x to the right and y down, that replaces the
            search.
        holes: "fill": holes are seen through the texture alone; "keep": they are holes of the mesh too.
        vertices: Number of mesh vertices.
        follow_veins: Main veins become edges of the mesh.
        map_size: Cells across and up (nx, ny), or None for no maps at all.
        maps: The maps wanted, among :data:`MAP_NAMES`: "auto", a number in [0, 1] (not for ``source``), or a picture
            of the same frame as the photo, of any size. The venation may also be one of :data:`VEIN_KINDS`.
        fine_venation: Keep the venation as finely as it is drawn, for water that flows along it.
        seed: Of what is made up: veins that the photo does not show, and the stomata's variation.
        texture_limit: Longest side of the texture [pixels]; None for that of the photo.
    """

    image: Path
    length: float | None = None
    pixels_per_metre: float | None = None
    mask: Path | None = None
    rect: tuple[float, float, float, float] | None = None
    base: tuple[float, float] | None = None
    holes: str = "fill"
    vertices: int = 1707
    follow_veins: bool = False
    map_size: tuple[int, int] | None = (256, 256)
    maps: Mapping[str, str | float | Path] = field(default_factory=dict)
    fine_venation: bool = True
    seed: int = 0
    texture_limit: int | None = None

    @property
    def pictures(self) -> tuple[Path, ...]:
        """The pictures that the leaf is made from beside the photo."""
        return tuple(path for path in (self.mask, *self.wanted_maps.values()) if isinstance(path, Path))

    @property
    def wanted_maps(self) -> dict[str, str | float | Path]:
        """The maps to make, in a fixed order, paths as paths; none without a map size."""
        if self.map_size is None:
            return {}
        kinds = {"auto", *VEIN_KINDS}
        return {
            name: Path(value) if isinstance(value, str) and value not in kinds else value
            for name in MAP_NAMES
            if (value := self.maps.get(name)) is not None
        }

    @property
    def vein_kind(self) -> str:
        """Where veins come from that are not given as a picture."""
        kind = self.maps.get("venation", "auto")
        return kind if kind in VEIN_KINDS else "auto"

    @property
    def needs_veins(self) -> bool:
        """Whether veins must be found."""
        maps = self.wanted_maps
        drawn = maps.get("venation") in ("auto", *VEIN_KINDS)
        return self.follow_veins or drawn or (maps.get("stomata") == "auto" and "venation" not in maps)

    def check(self) -> None:
        """Refuse what is not accepted.

        Raises:
            InputError: With the name, the value and what is accepted.
        """
        if self.length is None and self.pixels_per_metre is None:
            self._refuse("length", None, "the leaf's length [m], or pixels_per_metre")
        for name in ("length", "pixels_per_metre"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                self._refuse(name, value, "a number above 0")
        if isinstance(self.vertices, bool) or self.vertices != int(self.vertices):
            self._refuse("vertices", self.vertices, "a whole number")
        if self.holes not in ("fill", "keep"):
            self._refuse("holes", self.holes, "'fill' or 'keep'")
        size = self.map_size
        if size is not None and not (len(size) == 2 and all(n == int(n) and 1 <= n <= MOST_CELLS for n in size)):
            self._refuse("map_size", size, f"two numbers from 1 to {MOST_CELLS}")
        self._check_maps()

    def _check_maps(self) -> None:
        for name, value in self.maps.items():
            if name not in MAP_NAMES:
                raise InputError(f"{self.image}: maps: {name!r} is not accepted; accepted: {', '.join(MAP_NAMES)}")
            if isinstance(value, str | Path):
                continue
            if name == "source" or isinstance(value, bool) or not 0.0 <= value <= 1.0:
                number = "" if name == "source" else ", a number from 0 to 1"
                self._refuse(f"maps: {name}", value, f"'auto'{number} or an image path")

    def _refuse(self, name: str, value: object, accepted: str) -> None:
        what = "missing" if value is None else f"value {value!r} is not accepted"
        raise InputError(f"{self.image}: {name}: {what}; accepted: {accepted}")
