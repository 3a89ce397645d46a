"""The layers of a leaf's USD: the asset at rest, the root with its value clips, the manifest, a frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pxr import Kind, Sdf, Usd, UsdGeom, UsdShade, Vt

from leafwarp.leaf.leaf import Leaf
from leafwarp.usd.attributes import (
    DISPLAY_COLOR,
    EXTENT_PATH,
    GEOMETRY_PATH,
    LEAF_PATH,
    MATERIALS_PATH,
    MESH_PATH,
    PHOTO,
    SHADING_VARIANT_SET,
    WATER,
    AnimatedAttribute,
)
from leafwarp.usd.files import Files

TEXTURE_FILE_PATH = MATERIALS_PATH.AppendPath(f"{PHOTO}/texture").AppendProperty("inputs:file")
ROUGHNESS = 0.6  # a leaf's cuticle: neither glossy nor chalky
OPACITY_THRESHOLD = 0.5  # a texel is leaf or hole; above 0 it also keeps renderers from blending, which needs sorting


@dataclass(frozen=True)
class StageFacts:
    """What every layer that can be opened as a stage says of itself.

    Attributes:
        frames: The planned frame numbers, which are the time codes.
        fps: Frames, and so time codes, per second.
        up_axis: ``"Y"`` or ``"Z"``.
        metadata: Facts of the run, kept as the layer's custom data under ``leafwarp``.
    """

    frames: range
    fps: float
    up_axis: str
    metadata: Mapping[str, str]

    def author(self, layer: Sdf.Layer, first: int | None = None, last: int | None = None) -> None:
        """Write the facts to a layer; ``first`` and ``last`` narrow the time range to what there is."""
        layer.defaultPrim = LEAF_PATH.name
        layer.pseudoRoot.SetInfo("metersPerUnit", UsdGeom.LinearUnits.meters)
        layer.pseudoRoot.SetInfo("upAxis", self.up_axis)
        layer.timeCodesPerSecond = layer.framesPerSecond = self.fps
        layer.startTimeCode = self.frames[0] if first is None else first
        layer.endTimeCode = self.frames[-1] if last is None else last
        if self.metadata:
            layer.customLayerData = {"leafwarp": dict(self.metadata)}


def rest_layer(
    leaf: Leaf,
    attributes: tuple[AnimatedAttribute, ...],
    rest_values: Mapping[Sdf.Path, object],
    facts: StageFacts,
) -> Sdf.Layer:
    """The asset without its animation: hierarchy, topology, ``st``, materials, the rest pose as default.

    Only the path of the texture is left to :func:`set_texture`, as it depends on where the layer goes.

    Args:
        leaf: The leaf.
        attributes: The animated attributes.
        rest_values: The rest pose, by attribute path.
        facts: What the layer says of itself.
    """
    layer = Sdf.Layer.CreateAnonymous("rest.usdc")
    facts.author(layer)
    stage = Usd.Stage.Open(layer)
    root = UsdGeom.Xform.Define(stage, LEAF_PATH).GetPrim()
    Usd.ModelAPI(root).SetKind(Kind.Tokens.component)
    UsdGeom.Scope.Define(stage, GEOMETRY_PATH)
    mesh = UsdGeom.Mesh.Define(stage, MESH_PATH)
    _define_topology(mesh, leaf)
    declare_animation(layer, attributes)
    for path, value in rest_values.items():
        layer.GetAttributeAtPath(path).default = value
    _define_shading(stage, mesh, has_opacity=leaf.texture.shape[2] == 4, has_water_color=DISPLAY_COLOR in attributes)
    return layer


def _define_topology(mesh: UsdGeom.Mesh, leaf: Leaf) -> None:
    triangles = np.ascontiguousarray(leaf.mesh.triangles, np.int32)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(triangles), 3))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(triangles.ravel()))
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    st.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(leaf.uv, np.float32)))


def declare_animation(layer: Sdf.Layer, attributes: tuple[AnimatedAttribute, ...]) -> None:
    """Declare the animated attributes on the mesh, without values."""
    mesh = Sdf.CreatePrimInLayer(layer, MESH_PATH)
    for attribute in attributes:
        spec = Sdf.AttributeSpec(mesh, attribute.name, attribute.type_name)
        if attribute.interpolation:
            spec.SetInfo("interpolation", attribute.interpolation)
        if attribute.documentation:
            spec.documentation = attribute.documentation
    Sdf.AttributeSpec(mesh, EXTENT_PATH.name, Sdf.ValueTypeNames.Float3Array)


def _define_shading(stage: Usd.Stage, mesh: UsdGeom.Mesh, has_opacity: bool, has_water_color: bool) -> None:
    """Bind the photo, or offer it and the water's colour as variants: a preview surface cannot mix them."""
    UsdGeom.Scope.Define(stage, MATERIALS_PATH)
    binding = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    photo = _photo_material(stage, has_opacity)
    if not has_water_color:
        binding.Bind(photo)
        return
    materials = {PHOTO: photo, WATER: _water_material(stage)}
    variants = stage.GetPrimAtPath(LEAF_PATH).GetVariantSets().AddVariantSet(SHADING_VARIANT_SET)
    for name, material in materials.items():
        variants.AddVariant(name)
        variants.SetVariantSelection(name)
        with variants.GetVariantEditContext():
            binding.Bind(material)
    variants.SetVariantSelection(PHOTO)


def _preview_material(stage: Usd.Stage, name: str) -> tuple[UsdShade.Material, UsdShade.Shader]:
    """A material with a matt preview surface, and that surface."""
    path = MATERIALS_PATH.AppendChild(name)
    material = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, path.AppendChild("surface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(ROUGHNESS)
    surface.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(0.0)
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return material, surface


def _primvar_reader(
    stage: Usd.Stage, path: Sdf.Path, primvar: str, shader: str, type_name: Sdf.ValueTypeName
) -> UsdShade.Output:
    reader = UsdShade.Shader.Define(stage, path)
    reader.CreateIdAttr(shader)
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(primvar)
    return reader.CreateOutput("result", type_name)


def _photo_material(stage: Usd.Stage, has_opacity: bool) -> UsdShade.Material:
    """The texture as colour and, where it has a fourth channel, as a mask to see through the leaf's holes."""
    material, surface = _preview_material(stage, PHOTO)
    path = material.GetPath()
    st = _primvar_reader(stage, path.AppendChild("st"), "st", "UsdPrimvarReader_float2", Sdf.ValueTypeNames.Float2)
    image = UsdShade.Shader.Define(stage, TEXTURE_FILE_PATH.GetPrimPath())
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", Sdf.ValueTypeNames.Asset)
    image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
    for wrap in ("wrapS", "wrapT"):
        image.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("clamp")
    image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(st)
    surface.GetInput("diffuseColor").ConnectToSource(image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
    if has_opacity:
        opacity = surface.CreateInput("opacity", Sdf.ValueTypeNames.Float)
        opacity.ConnectToSource(image.CreateOutput("a", Sdf.ValueTypeNames.Float))
        surface.CreateInput("opacityThreshold", Sdf.ValueTypeNames.Float).Set(OPACITY_THRESHOLD)
    return material


def _water_material(stage: Usd.Stage) -> UsdShade.Material:
    material, surface = _preview_material(stage, WATER)
    surface.GetInput("diffuseColor").ConnectToSource(
        _primvar_reader(
            stage,
            material.GetPath().AppendChild("displayColor"),
            "displayColor",
            "UsdPrimvarReader_float3",
            Sdf.ValueTypeNames.Float3,
        )
    )
    return material


def set_texture(layer: Sdf.Layer, texture: str) -> None:
    """Say where the texture lies; a relative path is relative to the very layer that holds it."""
    layer.GetAttributeAtPath(TEXTURE_FILE_PATH).default = Sdf.AssetPath(texture)


def manifest_layer(attributes: tuple[AnimatedAttribute, ...]) -> Sdf.Layer:
    """The layer that tells value resolution which attributes to look up in the clips."""
    layer = Sdf.Layer.CreateAnonymous("manifest.usdc")
    declare_animation(layer, attributes)
    return layer


def clips_root_layer(files: Files, facts: StageFacts) -> Sdf.Layer:
    """The root during a run, written once: whichever frame files exist when it is opened are its animation.

    The rest pose comes from a sublayer: a default in the layer that carries the clips would hide them.
    """
    layer = Sdf.Layer.CreateAnonymous("root.usdc")
    layer.subLayerPaths.append(files.asset_path(files.rest, files.root))
    leaf = Sdf.CreatePrimInLayer(layer, LEAF_PATH)
    clips = {
        "templateAssetPath": files.frame_template,
        "templateStartTime": float(facts.frames[0]),
        "templateEndTime": float(facts.frames[-1]),
        "templateStride": float(facts.frames.step),
        "primPath": str(LEAF_PATH),
        "manifestAssetPath": Sdf.AssetPath(files.asset_path(files.manifest, files.root)),
    }
    leaf.SetInfo("clips", {"default": clips})
    facts.author(layer)
    return layer


def frame_layer(index: int, values: Mapping[Sdf.Path, object], attributes: tuple[AnimatedAttribute, ...]) -> Sdf.Layer:
    """One frame as a value clip: nothing but time samples at its own number."""
    layer = Sdf.Layer.CreateAnonymous("frame.usdc")
    mesh = Sdf.CreatePrimInLayer(layer, MESH_PATH)
    for attribute in attributes:
        Sdf.AttributeSpec(mesh, attribute.name, attribute.type_name)
    Sdf.AttributeSpec(mesh, EXTENT_PATH.name, Sdf.ValueTypeNames.Float3Array)
    for path, value in values.items():
        layer.SetTimeSample(path, float(index), value)
    return layer
