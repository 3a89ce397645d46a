"""Finding what is wrong with a USD: the faults that break DCC tools, most of which no validator sees."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pxr import Kind, Sdf, Tf, Usd, UsdGeom, UsdUtils, UsdValidation

UNIT_LENGTH_TOLERANCE = 1e-3  # of a normal: far above float32 rounding, far below what shading shows
EXTENT_TOLERANCE = 1e-6  # of the leaf's size: an extent is made of the points' own float32 values

# Number of values that each interpolation of a primvar asks for, from (points, faces, face corners). USD
# itself answers one of these names only: any other that is authored reads as the default.
_VALUE_COUNTS = {
    "constant": lambda points, faces, corners: 1,
    "uniform": lambda points, faces, corners: faces,
    "varying": lambda points, faces, corners: points,
    "vertex": lambda points, faces, corners: points,
    "faceVarying": lambda points, faces, corners: corners,
}


def check_usd(path: Path, *, unfinished: bool = False) -> list[str]:
    """Check a USD file of leaves.

    Beside the errors of USD's own validators it finds what those do not see: NaN values, arrays that do not
    fit the mesh, vertex indices out of range, faces that use a vertex twice, animation without a default
    value or outside the time range, missing stage facts (default prim, kind, unit, up axis, time range),
    extents that do not hold the points, and texture paths that are absolute or lead nowhere.

    Args:
        path: The file.
        unfinished: Whether the file of a killed run is fine: its frames end before the time range does.

    Returns:
        One line per problem; empty when there is none.
    """
    path = Path(path)
    if not path.is_file():
        return [f"{path}: no such file"]
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        stage = _open_afresh(path)
    except Tf.ErrorException as error:
        return [f"{path}: cannot be opened as USD: {_first_message(str(error))}"]
    problems = list(_stage_problems(stage))
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    if not meshes:
        problems.append("stage: no mesh")
    for mesh in meshes:
        problems += _mesh_problems(mesh, unfinished)
    for prim in stage.Traverse():
        problems += _asset_problems(prim)
    problems += (f"stage: {_first_line(item.commentary)}" for item in diagnostics.TakeUncoalescedDiagnostics())
    problems += _validator_errors(stage)
    diagnostics.TakeUncoalescedDiagnostics()  # validators' own: one takes a clip template for a file
    return problems


def _open_afresh(path: Path) -> Usd.Stage:
    """The stage as the file says it now, whatever this process has read of it before."""
    name = str(path.absolute())
    layer = Sdf.Layer.Find(name)
    if layer:
        layer.Reload()  # the root first: it may no longer have the sublayers that it had
    stage = Usd.Stage.Open(name)
    stage.Reload()
    return stage


def _first_message(diagnostic: str) -> str:
    """The first message of a USD exception, without the place in USD's source."""
    return _first_line(diagnostic.strip()).partition(" : ")[2].strip("'")


def _first_line(text: str) -> str:
    return text.splitlines()[0] if text else "?"


def _stage_problems(stage: Usd.Stage) -> Iterator[str]:
    root = stage.GetDefaultPrim()
    if not root:
        yield "stage: no default prim"
    elif not Kind.Registry.IsA(Usd.ModelAPI(root).GetKind(), Kind.Tokens.model):
        yield f"{root.GetPath()}: kind {Usd.ModelAPI(root).GetKind()!r} is missing or no model kind"
    if not UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        yield "stage: no metersPerUnit"
    if not stage.HasAuthoredMetadata(UsdGeom.Tokens.upAxis):
        yield "stage: no upAxis"
    if not stage.HasAuthoredTimeCodeRange():
        if any(attribute.ValueMightBeTimeVarying() for attribute in _attributes(stage)):
            yield "stage: animated, but no startTimeCode and endTimeCode"
    elif stage.GetStartTimeCode() > stage.GetEndTimeCode():
        start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
        yield f"stage: startTimeCode {start:g} is after endTimeCode {end:g}"
    if stage.GetTimeCodesPerSecond() != stage.GetFramesPerSecond():
        yield (
            f"stage: timeCodesPerSecond {stage.GetTimeCodesPerSecond():g} is not "
            f"framesPerSecond {stage.GetFramesPerSecond():g}"
        )


def _attributes(stage: Usd.Stage) -> Iterator[Usd.Attribute]:
    for prim in stage.Traverse():
        yield from prim.GetAuthoredAttributes()


def _mesh_problems(mesh: UsdGeom.Mesh, unfinished: bool) -> Iterator[str]:
    name = mesh.GetPath()
    counts = np.asarray(mesh.GetFaceVertexCountsAttr().Get() or (), np.int64)
    indices = np.asarray(mesh.GetFaceVertexIndicesAttr().Get() or (), np.int64)
    animated = [attribute for attribute in mesh.GetPrim().GetAuthoredAttributes() if attribute.GetNumTimeSamples()]
    point_count = len(_value(mesh.GetPointsAttr(), _times(mesh.GetPointsAttr())[0]))
    for problem in _topology_problems(counts, indices, point_count):
        yield f"{name}: {problem}"
    for problem in _animation_problems(mesh, animated, unfinished):
        yield f"{name}: {problem}"
    sizes = (point_count, len(counts), len(indices))
    for problem in (*_value_problems(mesh, sizes), *_extent_problems(mesh)):
        yield f"{name}: {problem}"


def _topology_problems(counts: np.ndarray, indices: np.ndarray, point_count: int) -> Iterator[str]:
    if counts.sum() != len(indices):
        yield f"faceVertexCounts add up to {counts.sum()}, but there are {len(indices)} faceVertexIndices"
        return
    outside = (indices < 0) | (indices >= point_count)
    if outside.any():
        yield f"faceVertexIndices: {indices[outside][0]} is out of range, there are {point_count} points"
    face = np.repeat(np.arange(len(counts)), counts)
    order = np.lexsort((indices, face))
    same = (np.diff(face[order]) == 0) & (np.diff(indices[order]) == 0)
    repeating = np.unique(face[order][1:][same])
    if len(repeating):
        first = repeating[0]
        yield f"faceVertexIndices: {len(repeating)} faces use a vertex twice, the first is face {first}"


def _animation_problems(mesh: UsdGeom.Mesh, animated: list[Usd.Attribute], unfinished: bool) -> Iterator[str]:
    stage = mesh.GetPrim().GetStage()
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    time_range = f"the time range {start:g} to {end:g}"
    points = mesh.GetPointsAttr()
    for attribute in animated:
        name, times = attribute.GetName(), attribute.GetTimeSamples()
        if attribute.Get() is None:
            yield f"{name}: animated without a default value"
        if name in ("faceVertexCounts", "faceVertexIndices", "primvars:st"):
            yield f"{name}: is animated, must stand still"
        elif times != points.GetTimeSamples():
            yield f"{name}: has samples at other times than the points"
        fractional = [time for time in times if time != round(time)]
        if fractional:
            yield f"{name}: time code {fractional[0]:g} is not a whole frame"
        if stage.HasAuthoredTimeCodeRange() and (times[0] < start or times[-1] > end):
            yield f"{name}: samples {times[0]:g} to {times[-1]:g} lie outside {time_range}"
    times = points.GetTimeSamples()
    if unfinished or not stage.HasAuthoredTimeCodeRange() or start == end:
        return
    if not times:
        yield f"points: no sample in {time_range}"
    elif times[0] > start or times[-1] < end:
        yield f"points: samples {times[0]:g} to {times[-1]:g} do not cover {time_range}"


def _value_problems(mesh: UsdGeom.Mesh, sizes: tuple[int, int, int]) -> Iterator[str]:
    """Array lengths, finiteness and unit normals at the default time and at every sample."""
    yield from _array_problems(mesh.GetPointsAttr(), sizes[0])
    yield from _array_problems(mesh.GetVelocitiesAttr(), sizes[0])
    yield from _array_problems(mesh.GetNormalsAttr(), _VALUE_COUNTS[mesh.GetNormalsInterpolation()](*sizes))
    for primvar in UsdGeom.PrimvarsAPI(mesh).GetPrimvarsWithValues():
        if not primvar.GetTypeName().isArray:
            continue
        count = _VALUE_COUNTS[primvar.GetInterpolation()](*sizes)
        if primvar.IsIndexed():
            yield from _index_problems(primvar, count)
        else:
            yield from _array_problems(primvar.GetAttr(), count * primvar.GetElementSize())


def _index_problems(primvar: UsdGeom.Primvar, count: int) -> Iterator[str]:
    indices = np.asarray(primvar.GetIndices() or ())
    available = len(primvar.Get() or ()) // primvar.GetElementSize()
    if len(indices) != count:
        yield f"{primvar.GetName()}: {len(indices)} indices, {count} expected"
    if len(indices) and (indices.min() < 0 or indices.max() >= available):
        yield f"{primvar.GetName()}: index {indices.max()} is out of range, there are {available} values"


def _array_problems(attribute: Usd.Attribute, count: int) -> Iterator[str]:
    name = attribute.GetName()
    for time in (Usd.TimeCode.Default(), *attribute.GetTimeSamples()):
        at_rest = time == Usd.TimeCode.Default()
        if at_rest and attribute.Get() is None:
            continue  # told with the animation
        value = _value(attribute, time)
        when = "at rest" if at_rest else f"at {time:g}"
        if len(value) != count:
            yield f"{name}: {len(value)} values {when}, {count} expected"
            return
        if value.dtype.kind == "f" and not np.isfinite(value).all():
            yield f"{name}: NaN or infinite values {when}"
            return
        if name == UsdGeom.Tokens.normals:
            error = np.abs(np.linalg.norm(value.astype(np.float64), axis=1) - 1).max(initial=0.0)
            if error > UNIT_LENGTH_TOLERANCE:
                yield f"{name}: lengths differ from 1 by up to {error:.2g} {when}"
                return


def _extent_problems(mesh: UsdGeom.Mesh) -> Iterator[str]:
    attribute = mesh.GetExtentAttr()
    if not attribute.HasAuthoredValue():
        yield "extent: missing"
        return
    for time in _times(mesh.GetPointsAttr()):
        points, extent = _value(mesh.GetPointsAttr(), time), _value(attribute, time)
        if not len(points) or not np.isfinite(points).all():
            return  # told before
        if extent.shape != (2, 3):
            yield f"extent: {len(extent)} values at {time}, 2 expected"
            return
        excess = max((extent[0] - points.min(axis=0)).max(), (points.max(axis=0) - extent[1]).max())
        if not excess <= EXTENT_TOLERANCE * np.ptp(points, axis=0).max():
            yield f"extent: does not hold the points at {time} by {excess:.3g}"
            return


def _times(attribute: Usd.Attribute) -> list[Usd.TimeCode]:
    """The times at which an attribute has a value of its own: the default time where it stands still."""
    return [Usd.TimeCode(time) for time in attribute.GetTimeSamples()] or [Usd.TimeCode.Default()]


def _value(attribute: Usd.Attribute, time: Usd.TimeCode | float) -> np.ndarray:
    value = attribute.Get(time) if attribute else None
    return np.asarray(value if value is not None else ())


def _asset_problems(prim: Usd.Prim) -> Iterator[str]:
    """Asset paths that tie the file to one machine or lead nowhere."""
    for attribute in prim.GetAuthoredAttributes():
        if attribute.GetTypeName() != Sdf.ValueTypeNames.Asset or attribute.Get() is None:
            continue
        authored, resolved = attribute.Get().path, attribute.Get().resolvedPath
        if os.path.isabs(authored) or re.match(r"[A-Za-z]:[\\/]|[a-z]+://", authored):
            yield f"{attribute.GetPath()}: path {authored!r} is absolute; it must be relative to the USD"
        if not resolved or not os.path.isfile(resolved):
            yield f"{attribute.GetPath()}: file {authored!r} does not exist"


def _validator_errors(stage: Usd.Stage) -> Iterator[str]:
    """Errors, not warnings, of every validator that USD brings along.

    One error is left out: a name template of value clips is reported as a missing file while no frame exists,
    or where the path holds characters that mean something in a file name pattern. Missing frames show in the
    samples.
    """
    templates = [Path(template).name for template in _clip_templates(stage)]
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    for error in UsdValidation.ValidationContext(validators).Validate(stage):
        message = _first_line(error.GetMessage())
        if error.GetType() != UsdValidation.ValidationErrorType.Error:
            continue
        if error.GetName() == "UnresolvableDependency" and any(name in message for name in templates):
            continue
        yield f"{error.GetName()}: {message}"


def _clip_templates(stage: Usd.Stage) -> Iterator[str]:
    for prim in stage.Traverse():
        for clip_set in Usd.ClipsAPI(prim).GetClips().values():
            if "templateAssetPath" in clip_set:
                yield clip_set["templateAssetPath"]
