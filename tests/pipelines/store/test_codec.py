from __future__ import annotations

import dataclasses
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Optional

import jaxtyping
import numpy as np
import OpenEXR
import PIL.Image
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import Float32, Float64, Int32, UInt32

from texloom.pipelines.media.sources import open_source
from texloom.pipelines.store import codec, exr
from texloom.pipelines.store.preview import picture
from texloom.pipelines.store.types import Hint
from texloom.stages.lookup.registry import find_stage, stage_names
from texloom.stages.vocabulary.arrays import (
    Channels,
    ColorField,
    Correspondence,
    Image,
    Layers,
    Mask,
    Page,
    ScalarMap,
    Spreadsheet,
    Vectors,
)
from texloom.stages.vocabulary.color import lab_from_linear, linear_from_srgb
from texloom.stages.vocabulary.declare import InputError

MADE = {"stage": "test.stage", "params": {"sigma": 0.5, "name": "größe"}}
PAGE = "<!doctype html>\r\n<title>größe 𝛼</title>\n"
PLANE = np.ones((4, 5), np.float32)
KINDS = {"bool": "Bool", "uint8": "UInt8", "uint16": "UInt16", "uint32": "UInt32", "uint64": "UInt64"}


def kind_of(hint: Any, name: str = "field") -> type[Any]:
    return dataclasses.make_dataclass("Result", [(name, hint)], frozen=True)


def array_type(dtype: str, rank: int) -> Any:
    kind = getattr(jaxtyping, KINDS.get(dtype, dtype.title()))
    return kind[np.ndarray, " ".join("abcd"[:rank])]


@dataclasses.dataclass(frozen=True)
class Everything:
    image: Image
    strength: ScalarMap
    mask: Mask
    match: Correspondence
    densities: Annotated[Float32[np.ndarray, "3 b b"], Layers(("La", "Lb", "ab"))]
    offsets: Vectors
    generators: Vectors
    weight: float
    peaks: int
    description: bool
    word: str
    scales: list[dict[str, Any]]
    table: dict[str, Any]
    page: Page
    guess: ScalarMap | None
    notes: Page | None
    score: Optional[float]  # noqa: UP045


@pytest.fixture
def everything(rng: np.random.Generator) -> Everything:
    def noise(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    strength = noise(7, 9)
    strength[0, :3] = np.nan, np.inf, -np.inf
    return Everything(
        image=Image(noise(8, 6, 5), ("R", "G", "B", "A", "roughness.base")),
        strength=strength,
        mask=noise(7, 9) > 0,
        match=rng.integers(0, 2**32, (8, 6, 2), np.uint32),
        densities=noise(3, 5, 5),
        offsets=noise(11, 2),
        generators=np.zeros((0, 2), np.float32),
        weight=float("nan"),
        peaks=2**70,
        description=True,
        word="größe",
        scales=[{"energy": float("inf"), "size": (3, 4)}, {"energy": np.float32(0.5)}],
        table={},
        page=PAGE,
        guess=None,
        notes=None,
        score=None,
    )


# -- folders


@st.composite
def arrays(draw: st.DrawFn) -> tuple[np.ndarray, Any]:
    dtype = np.dtype(draw(st.sampled_from(exr.STORABLE)))
    shape = tuple(draw(st.lists(st.integers(0, 5), min_size=1, max_size=4)))
    doubled = tuple(2 * size for size in shape)
    bits = np.random.default_rng(draw(st.integers(0, 99))).bytes(int(np.prod(doubled)) * dtype.itemsize)
    wide = np.frombuffer(bits, np.uint8 if dtype.name == "bool" else dtype).reshape(doubled)
    wide = wide > 127 if dtype.name == "bool" else wide
    values = wide[tuple(slice(None, None, draw(st.sampled_from([2, -2]))) for _ in shape)]
    form = draw(st.sampled_from(["strided", "C", "F"]))
    values = values if form == "strided" else values.copy(form)
    hint = array_type(dtype.name, len(shape))
    axis = draw(st.sampled_from([None, 0, -1]))
    if axis is not None and shape[axis] and len(shape) > 1:
        names = tuple(f"plane {index}" for index in range(shape[axis]))
        hint = Annotated[hint, Layers(names) if axis == 0 else Channels(names)]
    return values, hint


@given(arrays(), st.booleans())
def test_arrays_are_read_back_bit_identical(array: tuple[np.ndarray, Any], swapped: bool) -> None:
    values, hint = array
    kind = kind_of(hint)
    result = kind(values.astype(values.dtype.newbyteorder()) if swapped else values)
    with np.errstate(invalid="ignore"), TemporaryDirectory() as folder:
        codec.write(result, Path(folder), MADE)
        back = codec.read(kind, Path(folder))["field"]
    assert back.dtype == values.dtype
    assert back.shape == values.shape
    assert back.tobytes() == values.tobytes()
    assert back.flags.c_contiguous
    assert back.flags.writeable
    assert codec.digests(kind(back)) == codec.digests(kind(values))


def test_every_kind_of_output_is_read_back(everything: Everything, tmp_path: Path) -> None:
    files = codec.write(everything, tmp_path, MADE)
    assert sorted(files) == sorted(path.name for path in tmp_path.iterdir())
    back = codec.read(Everything, tmp_path)
    assert list(back) == [field.name for field in dataclasses.fields(Everything)]
    for name, value in back.items():
        expected = getattr(everything, name)
        if name == "image":
            assert value.channels == everything.image.channels
            np.testing.assert_array_equal(value.pixels, everything.image.pixels)
        elif isinstance(value, np.ndarray):
            assert value.dtype == expected.dtype
            np.testing.assert_array_equal(value, expected)
        elif name == "weight":
            assert np.isnan(value)
        elif name == "scales":
            assert value == [{"energy": float("inf"), "size": [3, 4]}, {"energy": 0.5}]
        else:
            assert value == expected
            assert type(value) is type(expected)
    assert codec.digests(Everything(**back)) == codec.digests(everything)


def test_only_the_named_outputs_are_read(everything: Everything, tmp_path: Path) -> None:
    codec.write(everything, tmp_path, MADE)
    assert list(codec.read(Everything, tmp_path, ["word", "mask", "guess"])) == ["word", "mask", "guess"]
    (tmp_path / codec.TABLES).unlink()
    assert codec.read(Everything, tmp_path, ["peaks"]) == {"peaks": 2**70}
    with pytest.raises(codec.ArtifactError, match=r"tables\.json"):
        codec.read(Everything, tmp_path, ["table"])


def test_the_header_describes_the_file(everything: Everything, tmp_path: Path) -> None:
    codec.write(everything, tmp_path, MADE)
    parts = {part.name(): part for part in OpenEXR.File(str(tmp_path / "result.exr"), separate_channels=True).parts}
    assert {name: sorted(part.channels) for name, part in parts.items()} == {
        "image": ["A", "B", "G", "R", "roughness.base"],
        "strength": ["strength"],
        "mask": ["mask"],
        "match": ["match.column", "match.row"],
        "densities": ["densities.La", "densities.Lb", "densities.ab"],
        "offsets": ["offsets.column", "offsets.row"],
    }
    np.testing.assert_array_equal(parts["match"].channels["match.row"].pixels, everything.match[..., 0])
    np.testing.assert_array_equal(parts["densities"].channels["densities.Lb"].pixels, everything.densities[1])
    np.testing.assert_array_equal(
        parts["offsets"].channels["offsets.column"].pixels, everything.offsets[None, :, 1]
    )
    assert {part.compression() for part in parts.values()} == {OpenEXR.ZSTD_COMPRESSION}
    header = parts["image"].header
    assert json.loads(header["texloom.provenance"]) == MADE
    assert json.loads(header["texloom.scalars"])["word"] == "größe"
    assert json.loads(header["texloom.arrays"])["generators"] == {
        "dtype": "float32",
        "shape": [0, 2],
        "channels": ["row", "column"],
    }


def test_a_result_without_arrays_is_still_an_exr(tmp_path: Path) -> None:
    kind = kind_of(dict[str, Any], "table")
    assert codec.write(kind({"score": 0.5}), tmp_path, MADE) == ["result.exr", "tables.json"]
    assert codec.read(kind, tmp_path) == {"table": {"score": 0.5}}
    assert codec.describe(tmp_path / "result.exr")["provenance"] == MADE


@pytest.mark.parametrize(
    ("hint", "suffix", "text"),
    [(Page, "html", PAGE), (Spreadsheet, "csv", "a,b\n1,2\n")],
    ids=["page", "spreadsheet"],
)
def test_texts_are_files_of_their_own(hint: Any, suffix: str, text: str, tmp_path: Path) -> None:
    kind, file = kind_of(hint), tmp_path / f"field.{suffix}"
    assert codec.write(kind(text), tmp_path, MADE) == ["result.exr", file.name]
    assert file.read_bytes() == text.encode()
    assert text not in codec.describe(tmp_path / "result.exr")["scalars"].values()
    assert codec.read(kind, tmp_path) == {"field": text}
    for damage in (lambda: file.write_bytes(b"\xff"), file.unlink):
        damage()
        with pytest.raises(codec.ArtifactError, match=re.escape(file.name)):
            codec.read(kind, tmp_path)
    codec.export(text, hint, file, MADE)
    assert file.read_bytes() == text.encode()


def test_outputs_of_every_stage_can_be_stored() -> None:
    for name in stage_names():
        for output, hint in find_stage(name).outputs.items():
            parsed = Hint.of(hint)
            assert parsed.is_array or parsed.is_table or parsed.plain in (float, int, bool, str), (name, output)


@pytest.mark.parametrize(
    ("hint", "value"),
    [
        (ScalarMap, np.zeros((3, 4))),
        (ScalarMap, np.zeros((3, 4, 1), np.float32)),
        (ScalarMap, [[0.5]]),
        (Vectors, np.zeros((3, 3), np.float32)),
        (Float32[np.ndarray, "b b"], np.zeros((3, 4), np.float32)),
        (Annotated[Float32[np.ndarray, "h w c"], Channels(("a", "b"))], np.zeros((3, 4, 3), np.float32)),
        (Annotated[Float32[np.ndarray, "h w 2"], Channels(("a", "a"))], np.zeros((3, 4, 2), np.float32)),
        (Image, Image(np.zeros((2, 2, 2), np.float32), ("Y", "Y"))),
        (Image, Image(np.zeros((2, 2, 2), np.float32), ("Y", ""))),
        (Image, Image(np.zeros((2, 2, 2), np.float32), ("Y", "x" * 300))),
        (jaxtyping.Complex64[np.ndarray, "n"], np.zeros(3, np.complex64)),
        (float, "1"),
        (int, 1.0),
        (int, True),
        (float, None),
        (set, {1}),
        (dict[str, Any], {"a": {1, 2}}),
        (Page, b"<p>"),
        (Page, "\udcff"),
        (Page, None),
    ],
)
def test_values_of_a_wrong_type_are_refused(hint: Any, value: Any, tmp_path: Path) -> None:
    result = kind_of(hint)(value)
    with pytest.raises(TypeError, match=r"^Result\.field: .+"):
        codec.write(result, tmp_path, MADE)
    with pytest.raises(TypeError, match=r"^Result\.field: .+"):
        codec.digests(result)
    assert not list(tmp_path.iterdir())


def test_digests_of_different_contents_differ() -> None:
    one = np.arange(6, dtype=np.float32).reshape(2, 3)
    row_column = Annotated[Float32[np.ndarray, "n 2"], Channels(("row", "column"))]
    column_row = Annotated[Float32[np.ndarray, "n 2"], Channels(("column", "row"))]
    contents = [
        (ScalarMap, one),
        (ScalarMap, one.reshape(3, 2)),
        (ScalarMap, one + 1),
        (array_type("float32", 1), one.ravel()),
        (array_type("uint32", 2), one.view(np.uint32)),
        (row_column, one.reshape(3, 2)),
        (column_row, one.reshape(3, 2)),
        (Image, Image(one[..., None], ("Y",))),
        (Image, Image(one[..., None], ("A",))),
        (ScalarMap, one[:0]),
        (ScalarMap, one[:, :0]),
        (ScalarMap | None, None),
        (float, 1.0),
        (int, 1),
        (str, "1"),
        (bool, True),
        (str, "true"),
        (float, float("nan")),
        (list[Any], [1]),
    ]

    def digest(hint: Any, value: Any, name: str = "field") -> str:
        return codec.digests(kind_of(hint, name)(value))[name]

    assert len({digest(hint, value) for hint, value in contents}) == len(contents)
    assert digest(ScalarMap, one, "other") == digest(ScalarMap, one)
    assert digest(dict[str, Any], {"a": 1, "b": 2}) == digest(dict[str, Any], {"b": 2, "a": 1})


# -- broken folders


def test_a_file_cut_anywhere_is_an_error(
    everything: Everything, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    codec.write(everything, tmp_path, MADE)
    path = tmp_path / "result.exr"
    whole = path.read_bytes()
    for length in [*range(0, len(whole), 97), len(whole) - 1]:
        path.write_bytes(whole[:length])
        with pytest.raises(codec.ArtifactError, match=r"^\S+result\.exr: .+$"):
            codec.read(Everything, tmp_path)
        with pytest.raises(InputError, match=r"result\.exr: not a whole EXR file"):
            codec.describe(path)
    path.unlink()
    with pytest.raises(codec.ArtifactError, match="no such file"):
        codec.read(Everything, tmp_path)


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        (kind_of(ScalarMap, "other"), "no output field"),
        (dataclasses.make_dataclass("Two", [("field", ScalarMap), ("more", ScalarMap)]), "more is missing"),
        (dataclasses.make_dataclass("Two", [("field", ScalarMap), ("more", float)]), "more is missing"),
        (kind_of(Mask), "is not bool"),
        (kind_of(Float64[np.ndarray, "h w"]), "is not float64"),
        (kind_of(array_type("float32", 1)), r"is not float32 \(a\)"),
        (kind_of(float), "field is missing"),
        (kind_of(Image), "is not an image"),
    ],
)
def test_a_folder_of_another_result_is_an_error(kind: type[Any], reason: str, tmp_path: Path) -> None:
    codec.write(kind_of(ScalarMap)(PLANE), tmp_path, MADE)
    with pytest.raises(codec.ArtifactError, match=reason):
        codec.read(kind, tmp_path)


@pytest.mark.parametrize(
    ("planes", "record"),
    [
        ({"field": np.ones((4, 5), np.float16)}, {}),
        ({"other": PLANE}, {}),
        ({"field": PLANE, "more": PLANE}, {}),
        ({"field": np.ones((5, 5), np.float32)}, {}),
        *(({"field": PLANE}, {"shape": shape}) for shape in ([-1, 5], "ab", None)),
        ({"field": PLANE}, {"dtype": "object"}),
    ],
)
def test_planes_that_do_not_fit_their_description_are_an_error(
    planes: dict[str, np.ndarray], record: dict[str, Any], tmp_path: Path
) -> None:
    records = {"field": {"dtype": "float32", "shape": [4, 5], "channels": [], **record}}
    about = {"texloom.scalars": "{}", "texloom.arrays": json.dumps(records)}
    exr.write(tmp_path / "result.exr", {"field": planes}, about, "ZIP")
    with pytest.raises(codec.ArtifactError):
        codec.read(kind_of(ScalarMap), tmp_path)


# -- previews


def opened(path: Path) -> np.ndarray:
    with PIL.Image.open(path) as picture:
        return np.asarray(picture)


def test_previews(everything: Everything, tmp_path: Path) -> None:
    files = codec.write(everything, tmp_path, MADE)
    names = {name.removesuffix(".png") for name in files if name.endswith(".png")}
    assert names == {"image", "strength", "mask", "match", "densities"}
    assert opened(tmp_path / "image.png").shape == (8, 6, 4)
    np.testing.assert_array_equal(opened(tmp_path / "mask.png"), everything.mask * np.uint8(255))
    strength = opened(tmp_path / "strength.png")
    assert strength.shape == (7, 9)
    assert strength[0, :3].tolist() == [0, 255, 0]
    finite = np.isfinite(everything.strength)
    values = everything.strength[finite]
    np.testing.assert_allclose(strength[finite], (values - values.min()) / np.ptp(values) * 255, atol=0.51)
    match = opened(tmp_path / "match.png").astype(int)
    shares = everything.match / everything.match.max(axis=(0, 1))
    np.testing.assert_allclose(match[..., :2], shares * 255, atol=0.51)
    assert not match[..., 2].any()
    densities = opened(tmp_path / "densities.png")
    assert densities.shape == (5, 15)
    first = everything.densities[0]
    np.testing.assert_allclose(densities[:, :5], (first - first.min()) / np.ptp(first) * 255, atol=0.51)


@pytest.mark.parametrize(
    ("hint", "value"),
    [
        (array_type("float32", 1), np.zeros(50, np.float32)),
        (Vectors, np.zeros((50, 2), np.float32)),
        (ScalarMap, np.zeros((3, 90), np.float32)),
        (ScalarMap, np.zeros((0, 90), np.float32)),
        (array_type("float32", 3), np.zeros((8, 8, 5), np.float32)),
        (array_type("float32", 4), np.zeros((8, 8, 5, 2), np.float32)),
    ],
)
def test_arrays_without_a_preview(hint: Any, value: np.ndarray, tmp_path: Path) -> None:
    assert codec.write(kind_of(hint)(value), tmp_path, MADE) == ["result.exr"]


@pytest.mark.parametrize(
    ("values", "shown"),
    [([[True] * 4] * 4, 255), ([[False] * 4] * 4, 0), ([[7.5] * 4] * 4, 255), ([[np.nan] * 4] * 4, 0)],
)
def test_previews_of_constant_arrays(values: list[list[float]], shown: int, tmp_path: Path) -> None:
    array = np.array(values) if values[0][0] in (True, False) else np.array(values, np.float32)
    codec.write(kind_of(array_type(array.dtype.name, 2))(array), tmp_path, MADE)
    assert np.unique(opened(tmp_path / "field.png")).tolist() == [shown]


# -- exports

RAMP = np.arange(256, dtype=np.uint8).reshape(16, 16)


@pytest.mark.parametrize("names", ["Y", "YA", "RGB", "RGBA"])
def test_png_in_png_out_loses_nothing(names: str, tmp_path: Path) -> None:
    levels = np.stack([np.roll(RAMP, 5 * index) for index in range(len(names))], axis=2)
    encoded = levels.astype(np.float32) / np.float32(255)
    pixels = linear_from_srgb(encoded).astype(np.float32)
    if "A" in names:
        pixels[..., -1] = encoded[..., -1]
    codec.export(Image(pixels, tuple(names)), Image, tmp_path / "a.png", MADE)
    np.testing.assert_array_equal(opened(tmp_path / "a.png"), levels if len(names) > 1 else levels[..., 0])
    with PIL.Image.open(tmp_path / "a.png") as picture:
        assert json.loads(picture.text["texloom.provenance"]) == MADE  # type: ignore[attr-defined]


def test_png_clips_light_and_leaves_out_other_channels(tmp_path: Path) -> None:
    pixels = np.float32([[[2, -1, np.nan, 0.3], [0.5, np.inf, 0, 0.3]]])
    codec.export(Image(pixels, ("R", "G", "B", "height")), Image, tmp_path / "a.png", MADE)
    assert opened(tmp_path / "a.png").tolist() == [[[255, 0, 0], [188, 255, 0]]]


def test_lab_is_shown_as_its_colour(tmp_path: Path, rng: np.random.Generator) -> None:
    levels = rng.integers(0, 256, (20, 20, 3), np.uint8)
    lab = lab_from_linear(linear_from_srgb(levels / 255).astype(np.float32))
    codec.export(lab, ColorField, tmp_path / "a.png", MADE)
    np.testing.assert_array_equal(opened(tmp_path / "a.png"), levels)


def test_an_exported_exr_is_plain(everything: Everything, tmp_path: Path) -> None:
    codec.export(everything.image, Image, tmp_path / "a.exr", MADE)
    content = (tmp_path / "a.exr").read_bytes()
    assert not content[5] & 0x10, "multi-part"
    (part,) = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).parts
    assert part.compression() == OpenEXR.ZIP_COMPRESSION
    for index, name in enumerate(everything.image.channels):
        np.testing.assert_array_equal(part.channels[name].pixels, everything.image.pixels[..., index])
    assert json.loads(part.header["texloom.provenance"]) == MADE


@pytest.mark.parametrize(
    ("made", "channels"),
    [
        ({}, {"found.row", "found.column"}),
        ({"output": "match"}, {"match.row", "match.column"}),
        ({"output": "texture.match"}, {"match.row", "match.column"}),
    ],
)
def test_an_exported_array_says_what_it_is(
    made: dict[str, Any], channels: set[str], everything: Everything, tmp_path: Path
) -> None:
    codec.export(everything.match, Correspondence, tmp_path / "found.exr", made)
    (layer,) = codec.describe(tmp_path / "found.exr")["layers"]
    assert set(layer["channels"]) == channels
    assert set(layer["channels"].values()) == {"uint32"}


@pytest.mark.parametrize("suffix", ["exr", "png"])
def test_two_exports_are_the_same_file(suffix: str, everything: Everything, tmp_path: Path) -> None:
    path = tmp_path / f"x.{suffix}"
    for value, hint in ((everything.image, Image), (everything.strength, ScalarMap)):
        contents = []
        for _ in range(2):
            codec.export(value, hint, path, MADE)
            contents.append(path.read_bytes())
        assert contents[0] == contents[1]


def test_json_exports(tmp_path: Path) -> None:
    codec.export({"b": 1, "a": [np.float64(0.5)]}, dict[str, Any], tmp_path / "a.json", MADE)
    assert (tmp_path / "a.json").read_text() == '{\n  "b": 1,\n  "a": [\n    0.5\n  ]\n}\n'
    codec.export(3.0, float, tmp_path / "a.json", MADE)
    assert (tmp_path / "a.json").read_text() == "3.0\n"


@pytest.mark.parametrize(
    ("value", "hint", "name"),
    [
        ({"a": float("nan")}, dict[str, Any], "a.json"),
        (float("inf"), float, "a.json"),
        (np.zeros((4, 4), np.float32), ScalarMap, "a.json"),
        (1.0, float, "a.exr"),
        ({}, dict[str, Any], "a.png"),
        (np.zeros((0, 2), np.float32), Vectors, "a.png"),
        (np.zeros((4, 4), np.float32), ScalarMap, "a.jpg"),
        (None, ScalarMap | None, "a.exr"),
        (PAGE, Page, "a.json"),
        (PAGE, Page, "a.csv"),
        ("a,b", Spreadsheet, "a.html"),
        ("a,b", str, "a.csv"),
        ("word", str, "a.html"),
        ({}, dict[str, Any], "a.html"),
        (None, Page | None, "a.html"),
    ],
)
def test_values_that_a_format_cannot_hold_are_refused(value: Any, hint: Any, name: str, tmp_path: Path) -> None:
    with pytest.raises(codec.ArtifactError, match=name):
        codec.export(value, hint, tmp_path / name, MADE)
    assert not list(tmp_path.iterdir())


def test_a_failed_export_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.json"
    path.write_text("old")

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        codec.export({}, dict[str, Any], path, MADE)
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("a.json", "old")]


# -- any EXR


def foreign(path: Path, *parts: tuple[str, dict[str, np.ndarray]]) -> Path:
    made = [OpenEXR.Part({"compression": OpenEXR.PIZ_COMPRESSION}, planes, name) for name, planes in parts]
    OpenEXR.File(made).write(str(path))
    return path


def test_any_exr_is_described(tmp_path: Path) -> None:
    half, whole = np.zeros((4, 6), np.float16), np.zeros((4, 6), np.float32)
    planes = {"R": half, "G": half, "B": half, "Z": whole, "diffuse.R": half, "diffuse.G": half, "diffuse.B": half}
    path = foreign(tmp_path / "a.exr", ("beauty", planes), ("ids", {"id": np.zeros((4, 6), np.uint32)}))
    description = codec.describe(path)
    assert json.loads(json.dumps(description)) == description
    assert description["compression"] == "PIZ"
    assert {(layer["part"], layer["name"]): layer["channels"] for layer in description["layers"]} == {
        ("beauty", "beauty"): {"B": "float16", "G": "float16", "R": "float16"},
        ("beauty", "Z"): {"Z": "float32"},
        ("beauty", "diffuse"): {"diffuse.B": "float16", "diffuse.G": "float16", "diffuse.R": "float16"},
        ("ids", "id"): {"id": "uint32"},
    }
    assert {(layer["height"], layer["width"]) for layer in description["layers"]} == {(4, 6)}
    assert "provenance" not in description


def test_a_result_is_described_by_outputs(everything: Everything, tmp_path: Path) -> None:
    codec.write(everything, tmp_path, MADE)
    description = codec.describe(tmp_path / "result.exr")
    assert [layer["name"] for layer in description["layers"]] == [
        *("image", "roughness", "strength", "mask", "match", "densities", "offsets")
    ]
    assert description["provenance"] == MADE
    assert description["scalars"]["peaks"] == 2**70


def test_every_layer_has_a_picture(everything: Everything, tmp_path: Path) -> None:
    codec.write(everything, tmp_path, MADE)
    for _ in range(2):  # the second time over the first
        made = codec.pictures(tmp_path / "result.exr", tmp_path / "new" / "png")
    names = ["image", "image.roughness", "strength", "mask", "match", "densities", "offsets"]
    assert [path.name for path in made] == [f"{name}.png" for name in names]
    assert sorted((tmp_path / "new" / "png").iterdir()) == sorted(made)
    for name in ("image.png", "strength.png", "mask.png", "match.png", "densities.png"):
        np.testing.assert_array_equal(opened(tmp_path / "new" / "png" / name), opened(tmp_path / name))


def test_planes_of_different_size_are_different_layers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = foreign(tmp_path / "a.exr", ("p", {"Y": np.zeros((8, 6), np.float32)}))
    header, _ = exr.load(path)
    planes = {"x.BY": np.zeros((4, 3), np.float16), "x.RY": np.zeros((4, 3), np.float16), "x.Y": np.ones((8, 6))}
    # OpenEXR reads such files, but writes none.
    monkeypatch.setattr(exr, "load", lambda *_, **__: (header, {"p": planes}))
    assert [opened(file).shape for file in codec.pictures(path, tmp_path)] == [(4, 6), (8, 6)]


@pytest.mark.parametrize(
    "layers",
    [
        ["..", ".", "", "...."],
        ["a_b_2", "a_b", "a/b", "A_B", "a\nb"],
        ["x" * 200, "x" * 201, "x" * 202],
        ["\x1b[31mred", "..\\..\\up", "~", "/", "wände"],
        ["../up", "/etc/x", "a b", "a/b"],
    ],
    ids=["dots", "alike", "long", "odd", "paths"],
)
def test_any_name_of_a_layer_makes_one_file_name_in_the_folder(layers: list[str], tmp_path: Path) -> None:
    plane = np.zeros((4, 6), np.float32)
    path = foreign(tmp_path / "a.exr", ("p", {f"{layer}.x": plane for layer in layers}))
    made = codec.pictures(path, tmp_path / "png")
    assert sorted((tmp_path / "png").iterdir()) == sorted(made)
    assert len({path.name.lower() for path in made}) == len(layers)
    assert all(re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,110}\.png", path.name) for path in made)
    assert len(list(tmp_path.iterdir())) == 2


def test_pictures_do_not_replace_other_files(tmp_path: Path) -> None:
    path = foreign(
        tmp_path / "a.exr", ("p", {"a.x": np.zeros((4, 6), np.float32), "b.x": np.eye(6, dtype="f4")[:4]})
    )
    (tmp_path / "png").mkdir()
    (tmp_path / "png" / "b.png").write_bytes(b"mine")
    for write in (codec.check_pictures, codec.pictures):
        with pytest.raises(InputError, match=r"b\.png: is there already"):
            write(path, tmp_path / "png")
    assert [one.read_bytes() for one in (tmp_path / "png").iterdir()] == [b"mine"]


def test_files_that_cannot_be_shown_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    planes = {"Y": np.random.default_rng(0).random((40, 50), np.float32)}
    path = foreign(tmp_path / "a.exr", ("one", planes), ("two", planes))
    (tmp_path / "cut.exr").write_bytes(path.read_bytes()[:-9])
    single = foreign(tmp_path / "single.exr", ("one", planes))
    single.write_bytes(single.read_bytes()[:-9])
    (tmp_path / "text.exr").write_text("not a picture")
    capfd.readouterr()
    reasons = {**dict.fromkeys(("cut", "single", "text"), "not a whole EXR"), "none": "no such file"}
    for name, reason in reasons.items():
        with pytest.raises(InputError, match=reason):
            codec.pictures(tmp_path / f"{name}.exr", tmp_path / "png")
    assert capfd.readouterr() == ("", ""), "what OpenEXR says is said by the error already"
    monkeypatch.setattr(codec, "_MAX_PIXELS", 1999)
    with pytest.raises(InputError, match="50 x 40 px are more than 1999 px"):
        codec.describe(path)
    assert not (tmp_path / "png").exists()


def test_importing_the_codec_is_light() -> None:
    heavy = ("OpenEXR", "PIL", "cv2")
    code = f"import sys, texloom.pipelines.store.codec; sys.exit(any(name in sys.modules for name in {heavy}))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_signed_numbers_are_stored_by_their_bits(tmp_path: Path) -> None:
    kind = dataclasses.make_dataclass("Two", [("a", Int32[np.ndarray, "n"]), ("b", UInt32[np.ndarray, "n"])])
    codec.write(kind(np.int32([-1, 1]), np.uint32([0, 2**32 - 1])), tmp_path, MADE)
    parts = {part.name(): part for part in OpenEXR.File(str(tmp_path / "result.exr"), separate_channels=True).parts}
    assert parts["a"].channels["a"].pixels.tolist() == [[2**32 - 1, 1]]
    assert parts["b"].channels["b"].pixels.tolist() == [[0, 2**32 - 1]]


# -- large arrays


def test_large_parts_are_tiled(tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exr, "TILED", 1999)
    monkeypatch.setattr(exr, "_TILE", 16)
    image = Image(rng.random((41, 50, 4), np.float32), ("R", "G", "B", "height"))
    path = tmp_path / "a.exr"
    codec.export(image, Image, path, MADE)
    with OpenEXR.File(str(path), header_only=True) as file:
        header = file.parts[0].header
        assert header["type"] == OpenEXR.tiledimage
        assert (header["tiles"].xSize, header["tiles"].ySize) == (16, 16)
    again = open_source("exemplar", str(path)).read()
    np.testing.assert_array_equal(again.pixels, image.pixels)
    description = codec.describe(path)
    assert description["provenance"] == MADE
    assert [layer["channels"] for layer in description["layers"]] == [
        {name: "float32"} if name == "height" else dict.fromkeys("BGR", "float32")
        for name in (layer["name"] for layer in description["layers"])
    ]
    assert len(codec.pictures(path, tmp_path / "pictures")) == 2
    small = tmp_path / "b.exr"
    codec.export(Image(image.pixels[:39], image.channels), Image, small, MADE)
    with OpenEXR.File(str(small), header_only=True) as file:
        assert file.parts[0].header["type"] == OpenEXR.scanlineimage


def shown(planes: dict[str, np.ndarray]) -> np.ndarray:
    levels = picture(planes)
    assert levels is not None
    return levels


def test_large_pictures_are_made_strip_by_strip(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    planes = dict(zip("RGBA", rng.random((4, 37, 20), np.float32) * 1.2, strict=True))
    positions = {"row": planes["R"] * 50, "column": planes["G"] * 30}
    colors_at_once, positions_at_once = shown(planes), shown(positions)
    monkeypatch.setattr("texloom.pipelines.store.preview._STRIP", 100)
    np.testing.assert_array_equal(shown(planes), colors_at_once)
    np.testing.assert_array_equal(shown(positions), positions_at_once)
    np.testing.assert_array_equal(shown({"Y": planes["R"]}), colors_at_once[..., 0])


def test_excluded_pixels_are_transparent(rng: np.random.Generator) -> None:
    planes = dict(zip("RGBA", rng.random((4, 7, 5), np.float32), strict=True))
    valid = (rng.random((7, 5)) < 0.5).astype(np.float32)
    whole, masked = shown(planes), shown({**planes, "usable": valid})
    opaque = shown({name: planes[name] for name in "RGB"} | {"usable": valid, "height": valid})
    np.testing.assert_array_equal(masked[..., :3], whole[..., :3])
    np.testing.assert_array_equal(masked[..., 3], np.where(valid > 0, whole[..., 3], 0))
    np.testing.assert_array_equal(opaque[..., 3], np.where(valid > 0, 255, 0))


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on the size of files")
def test_a_full_disk_is_an_error_and_leaves_nothing(tmp_path: Path, rng: np.random.Generator) -> None:
    import resource
    import signal

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    noise = rng.random((256, 256, 1), np.float32)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
    try:
        with pytest.raises(OSError, match=r"a\.exr"):
            codec.export(Image(noise, ("Y",)), Image, tmp_path / "a.exr", MADE)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("names", "read"),
    [
        ({"albedo": "Wall_BaseColor", "height": "höhe 2"}, {"albedo": "Wall_BaseColor", "height": "höhe 2"}),
        ({"albedo": "../a"}, {}),
        ({"albedo": ".a"}, {}),
        ({"albedo": "a\n"}, {}),
        ({"albedo": "a", "height": "A"}, {}),
        (["a"], {}),
    ],
)
def test_names_of_maps_that_can_be_names_of_files(names: object, read: dict[str, str]) -> None:
    assert codec.names_of_maps({"texloom.provenance": json.dumps({"names": names})}) == read
    assert codec.names_of_maps({}) == {}
