"""The nodes."""

from __future__ import annotations

from typing import Any, ClassVar

from comfy_execution.graph_utils import ExecutionBlocker

from .running import grey, image, levels, masks, paired, pictures, run_all

_MAPS = ("albedo", "normal", "roughness", "height", "metallic", "ao")
_GREY = _MAPS[2:]
_INPUTS = {"height": "height_map"}  # the result has a height, too
_METHODS = ["self_tuning", "auto", "near_regular", "quilting", "graph_cut", "patch_based"]
_SIZE = ("INT", {"default": 1024, "min": 16, "max": 8192})
_SEED = ("INT", {"default": 7, "min": 0, "max": 2**31 - 1, "tooltip": "equal seeds give equal results"})
_TILEABLE = (["off", "x", "y", "both"], {"tooltip": "the borders across which the result repeats"})
_PRESET = (["default", "fast"],)
_EXR = "texture.exr"
_EXEMPLARS = ("first", "second", "third", "fourth")


class _Node:
    CATEGORY = "texloom"
    FUNCTION = "make"
    RETURN_TYPES: ClassVar[tuple[str, ...]] = ("IMAGE",)


class Synthesise(_Node):
    """A larger texture that looks like the exemplar."""

    DESCRIPTION = "A larger texture like the exemplar. Of a batch, each picture has the next seed."
    RETURN_TYPES: ClassVar[tuple[str, ...]] = ("IMAGE", "TEXLOOM_RESULT")
    RETURN_NAMES: ClassVar[tuple[str, ...]] = ("image", "result")

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802 (ComfyUI's name)
        """What ComfyUI asks for."""
        required = {
            "exemplar": ("IMAGE",), "width": _SIZE, "height": _SIZE, "tileable": _TILEABLE,
            "method": (_METHODS,), "preset": _PRESET, "seed": _SEED,
        }  # fmt: skip
        return {"required": required, "optional": {"excluded": ("MASK", {"tooltip": "what is not to be used"})}}

    def make(
        self, exemplar: Any, width: int, height: int, tileable: str, method: str, preset: str, seed: int,
        excluded: Any = None,
    ) -> tuple[Any, ...]:  # fmt: skip
        """IMAGE and results; the exemplar's alpha is respected."""
        sources: list[dict[str, Any]] = [{"exemplar": one} for one in pictures(exemplar)]
        if excluded is not None:
            for given, mask in zip(sources, masks(excluded, len(sources), "excluded")):
                given["exemplar"] = {"albedo": given["exemplar"], "mask": 255 - mask}
        how = {} if preset == "default" else {"preset": preset}
        made = run_all(
            method, sources, seed=seed, size=f"{width}x{height}", tileable=tileable, files=(_EXR,), **how
        )
        return image([one.maps["albedo"] for one in made]), [one.files[_EXR] for one in made]


class MakeTileable(_Node):
    """A picture that repeats; only its borders change."""

    DESCRIPTION = "A new band along the borders; all else stays. Patterns are first cut to whole periods."

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """What ComfyUI asks for."""
        axes = (["both", "x", "y"], {"tooltip": "x: left and right borders; y: top and bottom"})
        band = ("INT", {"default": 0, "min": 0, "max": 4096, "tooltip": "width of the band, px; 0: by the size"})
        kept = ("BOOLEAN", {"default": True, "tooltip": "no cut to whole periods"})
        return {
            "required": {
                "image": ("IMAGE",), "axes": axes, "band": band, "keep_size": kept, "preset": _PRESET,
                "seed": _SEED,
            }
        }  # fmt: skip

    def make(self, image: Any, axes: str, band: int, keep_size: bool, preset: str, seed: int) -> tuple[Any, ...]:
        """IMAGE."""
        params = {"keep_size": keep_size, **({"width": band} if band else {})}
        return _edited(
            "make_tileable", [{"picture": one} for one in pictures(image)], preset, seed, params, tileable=axes
        )


class Material(_Node):
    """All maps of a material from one correspondence, so that they stay in register."""

    DESCRIPTION = "A larger material: what belongs together stays together in all maps."
    RETURN_TYPES: ClassVar[tuple[str, ...]] = ("IMAGE",) * len(_MAPS) + ("TEXLOOM_RESULT",)
    RETURN_NAMES: ClassVar[tuple[str, ...]] = (*_MAPS, "result")

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """What ComfyUI asks for."""
        required = {
            "albedo": ("IMAGE",), "width": _SIZE, "height": _SIZE, "tileable": (_TILEABLE[0], {"default": "both"}),
            "preset": _PRESET, "seed": _SEED,
        }  # fmt: skip
        return {"required": required, "optional": _optional_maps()}

    def make(
        self, width: int, height: int, tileable: str, preset: str, seed: int, green: str = "up", **maps: Any
    ) -> tuple[Any, ...]:
        """An IMAGE for every map that was given; the others block what is connected to them."""
        how = {} if preset == "default" else {"preset": preset}
        sources = [{"exemplar": one} for one in _materials(maps, green)]
        made = run_all(
            "materials", sources, seed=seed, size=f"{width}x{height}", tileable=tileable, files=(_EXR,), **how
        )
        return (*_images(made), [one.files[_EXR] for one in made])


class Reapply(_Node):
    """More maps of a material, in register with an earlier result; nothing is synthesised again."""

    DESCRIPTION = "Maps that came later, laid out as an earlier result. They have the size of its exemplar."
    RETURN_TYPES: ClassVar[tuple[str, ...]] = ("IMAGE",) * len(_MAPS)
    RETURN_NAMES: ClassVar[tuple[str, ...]] = _MAPS

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """What ComfyUI asks for."""
        return {"required": {"result": ("TEXLOOM_RESULT",), "albedo": ("IMAGE",)}, "optional": _optional_maps()}

    def make(self, result: list[bytes], green: str = "up", **maps: Any) -> tuple[Any, ...]:
        """An IMAGE for every map that was given."""
        materials = _materials(maps, green)
        if len(materials) != len(result):
            raise ValueError(f"albedo: {len(materials)} pictures for {len(result)} results; give as many")
        sources = [{"result": (_EXR, exr), "material": one} for exr, one in zip(result, materials)]
        return _images(run_all("reapply", sources))


class Fill(_Node):
    """Holes of a picture, filled from the rest of it."""

    DESCRIPTION = "What the mask covers is filled with texture from the rest, which stays as it is."

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """What ComfyUI asks for."""
        return {"required": {"image": ("IMAGE",), "mask": ("MASK",), "preset": _PRESET, "seed": _SEED}}

    def make(self, image: Any, mask: Any, preset: str, seed: int) -> tuple[Any, ...]:
        """IMAGE."""
        given = pictures(image)
        sources = [{"picture": one, "holes": hole} for one, hole in zip(given, masks(mask, len(given), "mask"))]
        return _edited("fill", sources, preset, seed, {})


class Revise(_Node):
    """A region of a texture, synthesised again."""

    DESCRIPTION = "What the mask covers is made again like the exemplar; the rest stays as it is."

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """What ComfyUI asks for."""
        required = {
            "texture": ("IMAGE",), "exemplar": ("IMAGE",), "mask": ("MASK",), "tileable": _TILEABLE,
            "preset": _PRESET, "seed": _SEED,
        }  # fmt: skip
        return {"required": required}

    def make(
        self, texture: Any, exemplar: Any, mask: Any, tileable: str, preset: str, seed: int
    ) -> tuple[Any, ...]:
        """IMAGE."""
        given = pictures(texture)
        exemplars = paired(pictures(exemplar), len(given), "exemplar", "textures")
        regions = masks(mask, len(given), "mask")
        sources = [
            {"texture": one, "exemplar": like, "region": region}
            for one, like, region in zip(given, exemplars, regions)
        ]
        return _edited("revise", sources, preset, seed, {}, tileable=tileable)


class Remix(_Node):
    """One texture of several exemplars."""

    DESCRIPTION = "One texture with patches of several exemplars. All pictures of a batch are exemplars."

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """What ComfyUI asks for."""
        told = "how much of the texture is from it, about, relative to the others, whatever its size"
        weight = ("FLOAT", {"default": 1.0, "min": 0.01, "max": 1000.0, "step": 0.05, "tooltip": told})
        tone = "how far mean and contrast of each exemplar are moved to those of all"
        required = {
            **dict.fromkeys(_EXEMPLARS[:2], ("IMAGE",)), **{f"{name}_weight": weight for name in _EXEMPLARS},
            "match_tone": ("FLOAT", {"default": 0.0, "min": 0.0, "max": 1.0, "step": 0.05, "tooltip": tone}),
            "width": _SIZE, "height": _SIZE, "tileable": _TILEABLE, "preset": _PRESET, "seed": _SEED,
        }  # fmt: skip
        return {"required": required, "optional": dict.fromkeys(_EXEMPLARS[2:], ("IMAGE",))}

    def make(
        self, match_tone: float, width: int, height: int, tileable: str, preset: str, seed: int, **inputs: Any
    ) -> tuple[Any, ...]:
        """IMAGE."""
        batches = {name: pictures(inputs[name]) for name in _EXEMPLARS if inputs.get(name) is not None}
        shares = [inputs[f"{name}_weight"] / len(batch) for name, batch in batches.items() for _ in batch]
        weights = {str(number): share for number, share in enumerate(shares, 1)}  # as texloom calls what is sent
        sources = [{"exemplars": [one for batch in batches.values() for one in batch]}]
        params = {"sheet.weights": weights, "match_tone": match_tone}
        return _edited("remix", sources, preset, seed, params, size=f"{width}x{height}", tileable=tileable)


class Mix(_Node):
    """A transition between two exemplars."""

    DESCRIPTION = (
        "The first exemplar where the mask is black, the second where it is white; without one, a gradient."
    )

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """What ComfyUI asks for."""
        turned = "direction of the gradient where there is no mask: 0 from left to right, 90 from top to bottom"
        patches = "0: one border where the mask is half; 1: patches wherever it is between black and white"
        colours = "where both are without structure, colours change gradually with the mask"
        required = {
            "first": ("IMAGE",), "second": ("IMAGE",), "width": _SIZE, "height": _SIZE,
            "angle": ("FLOAT", {"default": 0.0, "min": -360.0, "max": 360.0, "step": 5.0, "tooltip": turned}),
            "patchiness": ("FLOAT", {"default": 0.6, "min": 0.0, "max": 1.0, "step": 0.05, "tooltip": patches}),
            "gradual": ("BOOLEAN", {"default": True, "tooltip": colours}),
            "tileable": _TILEABLE, "preset": _PRESET, "seed": _SEED,
        }  # fmt: skip
        return {"required": required, "optional": {"mask": ("MASK", {"tooltip": "stretched to width and height"})}}

    def make(
        self, first: Any, second: Any, width: int, height: int, angle: float, patchiness: float, gradual: bool,
        tileable: str, preset: str, seed: int, mask: Any = None,
    ) -> tuple[Any, ...]:  # fmt: skip
        """IMAGE."""
        ones = pictures(first)
        others = paired(pictures(second), len(ones), "second", "first exemplars")
        sources: list[dict[str, Any]] = [{"exemplars": [one, other]} for one, other in zip(ones, others)]
        params: dict[str, Any] = {"patchiness": patchiness, "gradual": gradual}
        if mask is None:
            params["mixture.angle"] = angle
        else:
            for given, way in zip(sources, levels(mask, len(ones), "mask")):
                given["map"] = way
        return _edited("mix", sources, preset, seed, params, size=f"{width}x{height}", tileable=tileable)


def _edited(
    flow: str, sources: list[dict[str, Any]], preset: str, seed: int, params: dict[str, Any], **how: Any
) -> tuple[Any, ...]:
    how |= {} if preset == "default" else {"preset": preset}
    return (image([one.maps["albedo"] for one in run_all(flow, sources, seed=seed, params=params, **how)]),)


def _optional_maps() -> dict[str, Any]:
    green = (["up", "down"], {"tooltip": "where green of the normals points: up as in OpenGL, down as in DirectX"})
    return {**{_INPUTS.get(name, name): ("IMAGE",) for name in _MAPS[1:]}, "green": green}


def _materials(maps: dict[str, Any], green: str) -> list[dict[str, Any]]:
    """The maps of each material of a batch."""
    inputs = {name: maps.get(_INPUTS.get(name, name)) for name in _MAPS}
    given = {name: pictures(one) for name, one in inputs.items() if one is not None}
    given |= {name: [grey(one, name) for one in given[name]] for name in _GREY if name in given}
    counts = {name: len(one) for name, one in given.items()}
    if len(set(counts.values())) > 1:
        raise ValueError(f"the maps are batches of several sizes: {counts}; give as many of each")
    names = {"normal": "normal_gl" if green == "up" else "normal_dx"}
    return [
        {names.get(name, name): one[number] for name, one in given.items()} for number in range(counts["albedo"])
    ]


def _images(made: list[Any]) -> tuple[Any, ...]:
    """An output a map; what follows one that was not given does not run, and is told why."""
    first = made[0].maps
    names = {name: name for name in first} | {"normal": next((one for one in first if "normal" in one), "normal")}
    return tuple(
        image([one.maps[names[name]] for one in made]) if names.get(name) in first
        else ExecutionBlocker(f"texloom: no {_INPUTS.get(name, name)} was given")
        for name in _MAPS
    )  # fmt: skip


NODE_CLASS_MAPPINGS = {
    f"Texloom{node.__name__}": node
    for node in (Synthesise, MakeTileable, Material, Reapply, Fill, Revise, Remix, Mix)
}
NODE_DISPLAY_NAME_MAPPINGS = {
    "TexloomSynthesise": "Texloom: larger texture",
    "TexloomMakeTileable": "Texloom: make tileable",
    "TexloomMaterial": "Texloom: larger material",
    "TexloomReapply": "Texloom: reapply to more maps",
    "TexloomFill": "Texloom: fill a mask",
    "TexloomRevise": "Texloom: revise a mask",
    "TexloomRemix": "Texloom: remix exemplars",
    "TexloomMix": "Texloom: mix along a mask",
}
