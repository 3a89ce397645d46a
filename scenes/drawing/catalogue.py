"""The pictures that the scenes use: one entry a leaf."""

from __future__ import annotations

from dataclasses import dataclass

from .background import Backdrop
from .curves import Placement
from .leaves import LeafShape, Network, Parallel
from .outline import Petiole, Teeth
from .shading import Palette
from .venation import Rib


@dataclass(frozen=True)
class Picture:
    """A leaf, its colours and what it lies on."""

    shape: LeafShape
    palette: Palette
    backdrop: Backdrop


# The points of an outline read best several to a line.
# fmt: off
BRAMBLE = Picture(
    shape=LeafShape(
        seed=11,
        placement=Placement(1200, 1400, origin=(598.0, 1172.0), scale=1050.0, angle=2.0, bend=(-0.05, 0.075)),
        half_outline=(
            (
                (0.0, 0.0), (0.04, -0.020), (0.10, -0.026), (0.17, -0.004), (0.24, 0.05), (0.30, 0.13),
                (0.342, 0.23), (0.360, 0.34), (0.350, 0.45), (0.315, 0.56), (0.255, 0.66), (0.182, 0.75),
                (0.108, 0.835), (0.050, 0.905), (0.017, 0.957), (0.0, 1.0),
            ),
        ),
        petiole=Petiole(
            ((0.0, 0.012), (0.001, -0.03), (0.006, -0.08), (0.018, -0.135)), width=0.0235, base_width=0.029
        ),
        network=Network(ladder=(0.021, 0.040), mesh=(0.0085, 0.0085)),
        ribs=(
            Rib(
                length=1.0, pairs=9, insertion=(0.008, 0.86), angles=(84.0, 36.0), curve=0.42,
                width=0.0140, secondary_width=0.0068,
            ),
        ),
        teeth=Teeth(depth=0.20, small_depth=0.30, small_spacing=0.026),
    ),
    palette=Palette(
        lamina="#4b7c35", shade="#2c5a27", fresh="#7d9f47", vein="#c0cd90",
        petiole="#8f8a4c", margin="#3d5a24", quilting=1.5,
    ),
    backdrop=Backdrop("#f3f0e8"),
)

BLADE = Picture(
    shape=LeafShape(
        seed=23,
        placement=Placement(500, 1800, origin=(222.0, 1508.0), scale=1395.0, angle=-4.0, bend=(-0.075, 0.19)),
        half_outline=(
            ((0.0, -0.150), (0.0150, -0.150)),
            (
                (0.0150, -0.150), (0.0152, -0.09), (0.0150, -0.03), (0.0162, -0.004), (0.0215, 0.010),
                (0.0265, 0.05), (0.036, 0.15), (0.044, 0.29), (0.0465, 0.42), (0.0440, 0.56), (0.0375, 0.69),
                (0.028, 0.80), (0.017, 0.89), (0.0075, 0.95), (0.0, 1.0),
            ),
        ),
        petiole=None,
        network=Network(ladder=(0.0026, 0.16), mesh=(0.0011, 0.07)),
        parallel=Parallel(pairs=10, midrib_width=0.0085, width=0.0017),
        asymmetry=0.03,
        wobble=0.0001,
    ),
    palette=Palette(
        lamina="#5f8b3c", shade="#41712f", fresh="#94a855", vein="#c6cf96",
        petiole="#a3ad6a", margin="#7f9a4c", quilting=0.25, fold=0.22, waves=0.5, gloss=0.13, blemishes=8,
    ),
    backdrop=Backdrop("#a9aaa8", texture=0.02),
)

CUT = Picture(
    shape=LeafShape(
        seed=37,
        placement=Placement(1200, 1200, origin=(598.0, 775.0), scale=640.0, angle=-3.0, bend=(0.05, -0.03)),
        half_outline=(
            (
                (0.0, 0.0), (0.035, -0.055), (0.095, -0.135), (0.185, -0.185), (0.29, -0.205), (0.40, -0.205),
                (0.50, -0.200), (0.625, -0.22),
            ),
            (
                (0.625, -0.22), (0.560, -0.115), (0.51, -0.025), (0.455, 0.03), (0.435, 0.075), (0.475, 0.14),
                (0.56, 0.24), (0.640, 0.36), (0.695, 0.465), (0.775, 0.60),
            ),
            (
                (0.775, 0.60), (0.65, 0.535), (0.53, 0.515), (0.41, 0.468), (0.31, 0.395), (0.225, 0.352),
                (0.187, 0.40), (0.203, 0.52), (0.207, 0.64), (0.178, 0.75), (0.112, 0.855), (0.046, 0.945),
                (0.0, 1.05),
            ),
        ),
        petiole=Petiole(
            ((0.0, 0.015), (-0.002, -0.10), (0.008, -0.25), (0.045, -0.42)), width=0.024, base_width=0.036
        ),
        network=Network(ladder=(0.030, 0.060), mesh=(0.0125, 0.0125)),
        ribs=(
            Rib(
                length=1.05, pairs=6, insertion=(0.14, 0.86), angles=(58.0, 42.0), curve=0.30,
                width=0.017, secondary_width=0.0085,
            ),
            *(
                Rib(
                    length=0.980, direction=direction, pairs=6, insertion=(0.21, 0.86), angles=(58.0, 42.0),
                    curve=0.25, width=0.016, secondary_width=0.008,
                )
                for direction in (52.25, -52.25)
            ),
            *(
                Rib(
                    length=0.663, direction=direction, pairs=5, insertion=(0.16, 0.84), angles=(56.0, 42.0),
                    curve=0.3, width=0.013, secondary_width=0.007,
                )
                for direction in (109.39, -109.39)
            ),
        ),
        teeth=Teeth(depth=0.30, small_depth=0.26, small_spacing=0.052, slant=0.6, plain_tip=0.13),
        asymmetry=0.0,
    ),
    palette=Palette(
        lamina="#5b8436", shade="#37632a", fresh="#95a34a", vein="#cdd09a",
        petiole="#a0644f", margin="#566b2c", quilting=1.1, fold=0.03,
    ),
    backdrop=Backdrop("#cfdde8", texture=0.008),
)

STILL = Picture(
    shape=LeafShape(
        seed=5,
        placement=Placement(400, 600, origin=(199.0, 500.0), scale=430.0, angle=-1.5, bend=(0.03, -0.04)),
        half_outline=(
            (
                (0.0, 0.0), (0.022, 0.012), (0.072, 0.075), (0.130, 0.175), (0.176, 0.29), (0.200, 0.42),
                (0.198, 0.55), (0.172, 0.68), (0.126, 0.80), (0.070, 0.905), (0.026, 0.967), (0.0, 1.0),
            ),
        ),
        petiole=Petiole(
            ((0.0, 0.014), (0.0, -0.03), (-0.006, -0.08), (-0.018, -0.12)), width=0.026, base_width=0.034
        ),
        network=Network(ladder=(0.036, 0.055), mesh=(0.016, 0.016)),
        ribs=(
            Rib(
                length=1.0, pairs=8, insertion=(0.05, 0.84), angles=(62.0, 44.0), curve=2.3,
                width=0.018, secondary_width=0.0088,
            ),
        ),
    ),
    palette=Palette(
        lamina="#4d8540", shade="#2f662f", fresh="#86ad54", vein="#c8d7a0",
        petiole="#8d9a55", margin="#47703a",
        quilting=0.7, network=0.7, fold=0.06, waves=0.45, gloss=0.14, blemishes=3, vein_strength=0.75,
    ),
    backdrop=Backdrop(
        "#fbfbfa", texture=0.003, falloff=0.03, vignette=0.02, shadow=0.42, lift=5.0, grain=0.3
    ),
)

# fmt: on

PICTURES = {"bramble": BRAMBLE, "blade": BLADE, "cut": CUT, "still": STILL}
