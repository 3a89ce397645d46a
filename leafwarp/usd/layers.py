"""The layers of a USD of leaves: the asset at rest, the root with its value clips, the manifest, a frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdShade, Vt

from leafwarp.usd.attributes import DISPLAY_COLOR, EXTENT, AnimatedAttribute, turn_to_up_axis
from leafwarp.usd.files import Files
from leafwarp.usd.prims import LeafPrim, Prims

SHADING_VARIANT_SET = "shading"
PHOTO = "photo"
WATER = "water"
ROUGHNESS = 0.6  # a leaf's cuticle: neither glossy nor chalky
OPACITY_THRESHOLD = 0.5  # a texel is leaf or hole; above 0 it also keeps renderers from blending, which needs sorting


@dataclass(frozen=True)
class StageFacts:
    """What every layer that can be opened as a stage says of itself.

    Attributes:
        root: The default prim.
        frames: The planned frame numbers, which are the time codes.
        fps: Frames, and so time codes, per second.
        up_axis: ``"Y"`` or ``"Z"``.
        metadata: Facts of the run, kept as the layer's custom data under ``leafwarp``.
    """

    root: Sdf.Path
    frames: range
    fps: float
    up_axis: str
    metadata: Mapping[str, str]

    def author(self, layer: Sdf.Layer, first: int | None = None, last: int | None = None) -> None:
        """Write the facts to a layer; ``first`` and ``last`` narrow the time range to what there is."""
        layer.defaultPrim = self.root.name
        layer.pseudoRoot.SetInfo("metersPerUnit", UsdGeom.LinearUnits.meters)
        layer.pseudoRoot.SetInfo("upAxis", self.up_axis)
        layer.timeCodesPerSecond = layer.framesPerSecond = self.fps
        layer.startTimeCode = self.frames[0] if first is None else first
        layer.endTimeCode = self.frames[-1] if last is None else last
        if self.metadata:
            layer.customLayerData = {"leafwarp": dict(self.metadata)}


def rest_layer(
    prims: Prims,
    attributes: tuple[AnimatedAttribute, ...],
    rest_values: Mapping[Sdf.Path, object],
    facts: StageFacts,
) -> Sdf.Layer:
    """The asset without its animation: hierarchy, topology, ``st``, materials, the rest pose as default.

    Only the paths of the textures are left to :func:`set_textures`, as they depend on where the layer goes.

    Args:
        prims: The prims.
        attributes: The animated attributes.
        rest_values: The rest pose, by attribute path.
        facts: What the layer says of itself.
    """
    layer = Sdf.Layer.CreateAnonymous("rest.usdc")
    facts.author(layer)
    stage = Usd.Stage.Open(layer)
    if prims.is_many:
        root = UsdGeom.Xform.Define(stage, prims.root).GetPrim()
        Usd.ModelAPI(root).SetKind(Kind.Tokens.assembly)
    for leaf in prims.leaves:
        model = UsdGeom.Xform.Define(stage, leaf.model)
        Usd.ModelAPI(model.GetPrim()).SetKind(Kind.Tokens.component)
        if prims.is_many:
            place = turn_to_up_axis(np.array([leaf.place]), facts.up_axis)[0]
            model.AddTranslateOp().Set(Gf.Vec3d(*place.tolist()))
        if leaf.mesh.GetParentPath() != leaf.model:
            UsdGeom.Scope.Define(stage, leaf.mesh.GetParentPath())
        _define_topology(UsdGeom.Mesh.Define(stage, leaf.mesh), leaf)
    declare_animation(layer, prims.leaves, attributes)
    with Sdf.ChangeBlock():
        for path, value in rest_values.items():
            layer.GetAttributeAtPath(path).default = value
    _define_shading(stage, prims, has_water_color=DISPLAY_COLOR in attributes)
    return layer


def _define_topology(mesh: UsdGeom.Mesh, leaf: LeafPrim) -> None:
    triangles = np.ascontiguousarray(leaf.photo.mesh.triangles, np.int32)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(triangles), 3))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(triangles.ravel()))
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    st.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(leaf.photo.uv, np.float32)))


def declare_animation(
    layer: Sdf.Layer, leaves: Sequence[LeafPrim], attributes: tuple[AnimatedAttribute, ...], details: bool = True
) -> None:
    """Declare the animated attributes on the meshes, without values.

    Args:
        layer: The layer.
        leaves: The leaves.
        attributes: The attributes; the extent goes with them.
        details: Also say their interpolation and what they mean.
    """
    with Sdf.ChangeBlock():
        for leaf in leaves:
            mesh = Sdf.CreatePrimInLayer(layer, leaf.mesh)
            for attribute in attributes:
                spec = Sdf.AttributeSpec(mesh, attribute.name, attribute.type_name)
                if details and attribute.interpolation:
                    spec.SetInfo("interpolation", attribute.interpolation)
                if details and attribute.documentation:
                    spec.documentation = attribute.documentation
            Sdf.AttributeSpec(mesh, EXTENT, Sdf.ValueTypeNames.Float3Array)


def _define_shading(stage: Usd.Stage, prims: Prims, has_water_color: bool) -> None:
    """Bind the photos, or offer them and the water's colour as variants: a preview surface cannot mix them."""
    UsdGeom.Scope.Define(stage, prims.materials)
    bindings = [UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath(leaf.mesh)) for leaf in prims.leaves]
    photos = [
        _photo_material(stage, prims.photo_material(index), has_opacity=photo.texture.shape[2] == 4)
        for index, photo in enumerate(prims.photos)
    ]
    shown = [photos[leaf.photo_index] for leaf in prims.leaves]
    if not has_water_color:
        _bind(bindings, shown)
        return
    water = _water_material(stage, prims.materials.AppendChild(WATER))
    variants = stage.GetPrimAtPath(prims.root).GetVariantSets().AddVariantSet(SHADING_VARIANT_SET)
    for name, materials in ((PHOTO, shown), (WATER, [water] * len(shown))):
        variants.AddVariant(name)
        variants.SetVariantSelection(name)
        with variants.GetVariantEditContext():
            _bind(bindings, materials)
    variants.SetVariantSelection(PHOTO)


def _bind(bindings: Sequence[UsdShade.MaterialBindingAPI], materials: Sequence[UsdShade.Material]) -> None:
    for binding, material in zip(bindings, materials, strict=True):
        binding.Bind(material)


def _preview_material(stage: Usd.Stage, path: Sdf.Path) -> tuple[UsdShade.Material, UsdShade.Shader]:
    """A material with a matt preview surface, and that surface."""
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


def _photo_material(stage: Usd.Stage, path: Sdf.Path, has_opacity: bool) -> UsdShade.Material:
    """The texture as colour and, where it has a fourth channel, as a mask to see through the leaf's holes."""
    material, surface = _preview_material(stage, path)
    st = _primvar_reader(stage, path.AppendChild("st"), "st", "UsdPrimvarReader_float2", Sdf.ValueTypeNames.Float2)
    image = UsdShade.Shader.Define(stage, path.AppendChild("texture"))
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


def _water_material(stage: Usd.Stage, path: Sdf.Path) -> UsdShade.Material:
    material, surface = _preview_material(stage, path)
    surface.GetInput("diffuseColor").ConnectToSource(
        _primvar_reader(
            stage,
            path.AppendChild("displayColor"),
            "displayColor",
            "UsdPrimvarReader_float3",
            Sdf.ValueTypeNames.Float3,
        )
    )
    return material


def set_textures(layer: Sdf.Layer, prims: Prims, textures: Sequence[str]) -> None:
    """Say where each photo's texture lies; a relative path is relative to the very layer that holds it."""
    for index, texture in enumerate(textures):
        layer.GetAttributeAtPath(prims.texture_file(index)).default = Sdf.AssetPath(texture)


def manifest_layer(leaves: Sequence[LeafPrim], attributes: tuple[AnimatedAttribute, ...]) -> Sdf.Layer:
    """The layer that tells value resolution which attributes to look up in the clips."""
    layer = Sdf.Layer.CreateAnonymous("manifest.usdc")
    declare_animation(layer, leaves, attributes)
    return layer


def clips_root_layer(files: Files, facts: StageFacts) -> Sdf.Layer:
    """The root during a run, written once: whichever frame files exist when it is opened are its animation.

    The rest pose comes from a sublayer: a default in the layer that carries the clips would hide them.
    """
    layer = Sdf.Layer.CreateAnonymous("root.usdc")
    layer.subLayerPaths.append(files.asset_path(files.rest, files.root))
    root = Sdf.CreatePrimInLayer(layer, facts.root)
    clips = {
        "templateAssetPath": files.frame_template,
        "templateStartTime": float(facts.frames[0]),
        "templateEndTime": float(facts.frames[-1]),
        "templateStride": float(facts.frames.step),
        "primPath": str(facts.root),
        "manifestAssetPath": Sdf.AssetPath(files.asset_path(files.manifest, files.root)),
    }
    root.SetInfo("clips", {"default": clips})
    facts.author(layer)
    return layer


def frame_layer(
    index: int,
    values: Mapping[Sdf.Path, object],
    leaves: Sequence[LeafPrim],
    attributes: tuple[AnimatedAttribute, ...],
) -> Sdf.Layer:
    """One frame as a value clip: nothing but time samples at its own number."""
    layer = Sdf.Layer.CreateAnonymous("frame.usdc")
    declare_animation(layer, leaves, attributes, details=False)
    with Sdf.ChangeBlock():
        for path, value in values.items():
            layer.SetTimeSample(path, float(index), value)
    return layer
