"""Tables of the run: its clocks, how it is computed, and what is written."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, Strict

from leafwarp.scene.fields import Integer, Number, Switch, Table, Time


class TimeTable(Table):
    """Two clocks: plant time, which the water sees, and playback time, which gravity and inertia see."""

    duration: Annotated[Time, Field(gt=0.0, le=1e12)] = Field(
        description="Plant time from the first frame to the last [s]."
    )
    frames: Integer = Field(240, ge=1, le=1_000_000, description="Number of frames.")
    fps: Number = Field(24.0, ge=0.01, le=1000.0, description="Frames a second of playback.")


class SolverTable(Table):
    """How the scene is computed."""

    precision: Literal["float32", "float64"] = Field(
        "float32",
        description="Numbers of the fluid and the structure; always float64 unless motion.method is explicit.",
    )
    maximum_substeps: Integer = Field(
        8192, ge=1, le=2**20, description="Motion substeps a frame beyond which a scene is refused."
    )


class OutputTable(Table):
    """What is written beside the animated points and the water."""

    contact_sheet: Switch = Field(False, description="A picture of eight moments, water above and leaf below.")
    display_color: Switch = Field(False, description="Vertex colours: a plain ramp of water from brown to green.")
    texture_limit: Annotated[int, Strict(), Field(ge=16, le=65536)] | None = Field(
        None, description="Longest side of the texture [pixel]; default: as fine as the photo."
    )
    up_axis: Literal["Y", "Z"] = Field("Z", description="Up axis of the USD.")
