"""Tables of the run: its clocks, how it is computed, and what is written."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from leafwarp.scene.fields import Bounds, Integer, Number, Switch, Table, Time


class TimeTable(Table):
    """Two clocks: plant time, which the water sees, and playback time, which gravity and inertia see."""

    duration: Annotated[Time, Bounds(0.0, 1e12, "s", above=True)] = Field(
        description="Plant time from the first frame to the last [s]."
    )
    frames: Annotated[Integer, Bounds(1, 1_000_000)] = Field(240, description="Number of frames.")
    fps: Annotated[Number, Bounds(0.01, 1000.0)] = Field(24.0, description="Frames a second of playback.")


class SolverTable(Table):
    """How the scene is computed."""

    precision: Literal["float32", "float64"] = Field(
        "float32",
        description="Numbers of the fluid and the structure; always float64 unless motion.method is explicit.",
    )
    maximum_substeps: Annotated[Integer, Bounds(1, 2**20)] = Field(
        8192, description="Motion substeps a frame beyond which a scene is refused."
    )
    substep: Annotated[Number, Bounds(0.0, 1.0, above=True)] = Field(
        0.9,
        description="Substep of explicit motion over the longest stable one; what is left of it covers a frame's "
        "change of geometry.",
    )
    force_tolerance: Annotated[Number, Bounds(1e-8, 1.0)] = Field(
        1e-3,
        description="Force that implicit motion leaves on a vertex, over the mean of load and inertia and a hundredth "
        "of its bending force; equilibria: a tenth of it.",
    )
    coupling_interval: Annotated[Time, Bounds(0.0, 1e12, "s", above=True)] | None = Field(
        None,
        description="Plant time between two moments at which the structure is told of the water [s], held to a whole "
        "number of them; frames in between show the water of the last one, and the structure goes over to the next in "
        "the motion that ends with it, a frame at most. Default: at every frame, and in between "
        "where explicit motion would feel a jump.",
    )


class OutputTable(Table):
    """What is written beside the animated points and the water."""

    contact_sheet: Switch = Field(False, description="A picture of eight moments, water above and leaf below.")
    display_color: Switch = Field(False, description="Vertex colours: a plain ramp of water from brown to green.")
    texture_limit: Annotated[Integer, Bounds(16, 65536)] | None = Field(
        None, description="Longest side of the texture [pixel]; default: as fine as the photo."
    )
    up_axis: Literal["Y", "Z"] = Field("Z", description="Up axis of the USD.")
