"""`import texloom`: synthesize, run and plan, with arrays in and out."""

from __future__ import annotations

import importlib.metadata
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

import texloom
from texloom.pipelines.api import Event
from texloom.pipelines.flow import loader
from texloom.pipelines.media.sources import open_source
from texloom.pipelines.store import codec, housekeeping
from texloom.pipelines.store.store import Store
from texloom.pipelines.yaml import read_document
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import linear_from_srgb

FAST = {"method": "quilting", "size": (48, 64), "seed": 3}


@pytest.fixture(autouse=True)
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stores of the tests' own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("TEXLOOM_STORE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture
def rgb(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 256, (40, 40, 3), np.uint8)


def copied(exemplar: np.ndarray, source_map: np.ndarray) -> np.ndarray:
    """The exemplar's pixels where the texture says that it has them from."""
    row, column = np.moveaxis(source_map, 2, 0)
    return exemplar[row, column]


# -- synthesize


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float16, np.float32, np.float64])
@pytest.mark.parametrize("planes", [None, 1, 3, 4])
def test_image_is_of_the_kind_of_the_exemplar(rgb: np.ndarray, dtype: Any, planes: int | None) -> None:
    """Quilting copies pixels: so each comes back exactly, whatever its type."""
    values = np.dstack([rgb, np.full_like(rgb[..., 0], 255)])
    exemplar = {np.uint8: values, np.uint16: values * np.uint16(257) ^ 3}.get(dtype, (values / 255).astype(dtype))
    exemplar = exemplar[..., 0] if planes is None else exemplar[..., :planes]
    made = texloom.synthesize(exemplar, **FAST)
    assert made.image.dtype == dtype
    assert made.image.shape == (48, 64, *exemplar.shape[2:])
    expected = copied(exemplar.astype(np.float32).astype(dtype), made.source_map)
    assert np.array_equal(made.image, expected)
    assert list(made.maps) == ["albedo"]


def test_paths_are_exemplars_too(rgb: np.ndarray, tmp_path: Path) -> None:
    PIL.Image.fromarray(rgb).save(tmp_path / "a.png")
    for path in ("a.png", tmp_path / "a.png"):
        made = texloom.synthesize(path, **FAST)
        assert np.array_equal(made.image, copied(rgb, made.source_map))
    PIL.Image.fromarray(rgb[..., 0]).save(tmp_path / "grey.png")
    assert texloom.synthesize("grey.png", **FAST).image.shape == (48, 64)


def test_nothing_is_left_behind_but_the_cache(rgb: np.ndarray, tmp_path: Path) -> None:
    texloom.synthesize(rgb, **FAST)
    assert [path.name for path in tmp_path.iterdir()] == ["cache"]
    texloom.synthesize(rgb, **FAST, store=tmp_path / "mine")
    assert (tmp_path / "mine" / "cache").is_dir()
    assert not (tmp_path / "mine" / "runs").exists()


def test_store_follows_the_environment(rgb: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXLOOM_STORE", str(tmp_path / "elsewhere"))
    texloom.synthesize(rgb, **FAST)
    assert {path.name for path in tmp_path.iterdir()} - {"cache"} == {"elsewhere"}
    assert not (tmp_path / "cache" / "texloom" / "store").exists()


def test_equal_calls_are_cached(rgb: np.ndarray) -> None:
    first = texloom.synthesize(rgb, **FAST)
    assert {report.state for report in first.result.reports} == {"ran"}
    again = texloom.synthesize(rgb.copy(), **FAST)
    assert {report.state for report in again.result.reports} == {"cached"}
    assert np.array_equal(first.image, again.image)
    other = texloom.synthesize(rgb, **{**FAST, "seed": 4})
    assert "ran" in {report.state for report in other.result.reports}
    assert not np.array_equal(other.image, first.image)


def test_the_flow_is_read_once(rgb: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[Path] = []
    monkeypatch.setattr(loader, "read_document", lambda path: read.append(path) or read_document(path))
    texloom.synthesize(rgb, **FAST)
    assert [path.name for path in read] == ["quilting.yaml"]


def test_common_parameters_and_others(rgb: np.ndarray) -> None:
    made = texloom.synthesize(
        rgb, method="quilting", size=64, tileable=True, params={"texture.block": np.int64(16)}
    )
    assert made.image.shape == (64, 64, 3)
    chosen = codec.describe(made.result["texture"].folder / "result.exr")["provenance"]["params"]
    assert (chosen["tileable"], chosen["block"]) == (True, 16)


def test_self_tuning_is_the_default() -> None:
    row, column = np.indices((48, 48))
    spots = np.uint8(255 * (np.hypot(row % 12 - 6, column % 12 - 6) < 4))
    made = texloom.synthesize(spots, size=64, preset="fast")
    assert made.image.shape == (64, 64)
    assert made.scores["summary"]
    assert {"edges", "structure", "distance", "guidance", "lattice", "start", "texture", "scores"} <= set(
        made.result
    )


def test_masks_exclude(rgb: np.ndarray, tmp_path: Path) -> None:
    mask = np.ones((40, 40), bool)
    mask[:10] = False
    for exemplar in (rgb, {"albedo": rgb}):
        made = texloom.synthesize(exemplar, mask=mask, **FAST)
        assert made.source_map[..., 0].min() >= 10
        assert np.array_equal(made.image, copied(rgb, made.source_map))
        assert list(made.maps) == ["albedo"]
    PIL.Image.fromarray(rgb).save(tmp_path / "a.png")
    PIL.Image.fromarray(np.uint8(255 * mask)).save(tmp_path / "mask.png")  # the same in files: black is excluded
    made = texloom.synthesize("a.png", mask="mask.png", **FAST)
    assert made.source_map[..., 0].min() >= 10
    assert np.array_equal(made.image, copied(rgb, made.source_map))


def test_masked_arrays_exclude(rgb: np.ndarray) -> None:
    mask = np.zeros((40, 40), bool)
    mask[:10] = True
    told: list[texloom.Event] = []
    for values in (rgb, rgb.astype(np.float32) / 255):
        exemplar = np.ma.array(values, mask=np.repeat(mask[..., None], 3, axis=2))
        made = texloom.synthesize(exemplar, progress=told.append, **FAST)
        assert made.source_map[..., 0].min() >= 10
        assert made.image.dtype == values.dtype
    assert "exemplar: 400 masked pixels are excluded" in [event.text for event in told if event.kind == "note"]
    image = texloom.Image.of(np.ma.array(rgb[..., 0], mask=mask))
    assert image.channels == ("Y", "usable")
    assert np.array_equal(image.pixels[..., 1] == 0, mask)
    masked = np.ma.array(rgb[..., 0], mask=mask)
    for call in (
        lambda: texloom.run("hybrid", {"exemplar": rgb, "layout": masked}, size=40),
        lambda: texloom.plan("hybrid", {"exemplar": rgb, "layout": masked}, size=40),
        lambda: texloom.synthesize({"albedo": rgb, "height": masked}),
        lambda: texloom.synthesize(masked, mask=~mask),
        lambda: texloom.stages.exclusion_mask(rgb, mask=masked),
    ):
        with pytest.raises(texloom.InputError, match="masked array"):
            call()


def test_maps_ride_along(rgb: np.ndarray, rng: np.random.Generator, tmp_path: Path) -> None:
    vectors = rng.normal(size=(40, 40, 3)).astype(np.float32)
    vectors /= np.linalg.norm(vectors, axis=2, keepdims=True)
    rough = np.stack([rgb[..., 1]] * 3, axis=2)
    PIL.Image.fromarray(rgb[..., 2]).save(tmp_path / "metal.png")
    maps = {"Color": rgb, "normal_dx": vectors, "roughness": rough, "height": rng.random((40, 40))}
    made = texloom.synthesize({**maps, "metallic": tmp_path / "metal.png"}, **FAST)
    assert list(made.maps) == [*maps, "metallic"]
    for name, values in maps.items():
        assert made.maps[name].dtype == values.dtype
        assert made.maps[name] == pytest.approx(copied(values, made.source_map), abs=1e-6)
    assert np.array_equal(made.maps["metallic"], copied(rgb[..., 2], made.source_map))
    folder = made.save(tmp_path / "material")
    assert {"material.exr", "material.mtlx", "roughness.png"} <= {path.name for path in folder.iterdir()}
    again = texloom.synthesize(folder, **{**FAST, "size": 32})
    assert set(again.maps) == {"albedo", "normal", "roughness", "height", "metallic"}


def test_textures_are_saved_by_extension(rgb: np.ndarray, tmp_path: Path) -> None:
    made = texloom.synthesize(rgb, **FAST)
    assert np.array_equal(np.asarray(PIL.Image.open(made.save(tmp_path / "new" / "a.png"))), made.image)
    exr = open_source("a", str(made.save(tmp_path / "a.exr"))).read()
    assert np.array_equal(exr.pixels, made.linear.pixels)
    deep = texloom.synthesize(rgb[..., 0].astype(np.uint16) * 257, **FAST)
    assert np.array_equal(np.asarray(PIL.Image.open(deep.save(tmp_path / "b.png"))), deep.image)
    with pytest.raises(texloom.InputError, match=r"no writer for '.gif'; .exr, .png, .*a folder"):
        made.save(tmp_path / "a.gif")


def test_textures_are_shown_in_notebooks(rgb: np.ndarray) -> None:
    made = texloom.synthesize(rgb, **FAST)
    assert made._repr_png_().startswith(b"\x89PNG")
    assert "64 x 48 px, quilting, seed 3" in made._repr_html_()
    assert repr(made) == "<Texture 64 x 48 px, albedo, by quilting>"


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"method": "per_pixel_control"}, "sources: texture, control, target"),
        ({"method": "self_tunning"}, "did you mean 'self_tuning'"),
        ({"size": 3}, "^params size: the side should be greater than or equal to 16, got 3"),
        ({"params": {"texture.occurence": 3}}, "^params texture.occurence: .* did you mean 'occurrence'"),
        ({"params": {"texture.weights": object()}}, "a parameter cannot hold a value of type object"),
        ({"preset": "slow"}, "^params preset: input"),
        ({"image": np.zeros((1, 1, 3), np.uint8)}, r"^sources.exemplar: array of shape \(1, 1, 3\): is too small"),
        ({"image": np.zeros((6, 6), np.uint8)}, r"too small.*\(exemplar is array of shape \(6, 6\)\)"),
        ({"image": np.zeros((40, 40), bool)}, "array of bool is no image"),
        (
            {"image": np.full((40, 40, 3), 255.0)},
            "float64 with whole numbers up to 255 holds levels, not linear light",
        ),
        ({"image": 3}, "a value of type int is not a picture"),
        ({"image": np.zeros((40, 50, 2), np.uint8)}, r"an array of shape \(40, 50, 2\) is no image"),
        ({"image": np.zeros(40, np.uint8)}, r"an array of shape \(40,\) is no image"),
        ({"image": np.array(7, np.uint8)}, r"an array of shape \(\) is no image"),
        ({"image": "nothing.png"}, "no such file"),
        ({"image": {"albedo": np.zeros((8, 8)), "rough ness?": np.zeros((8, 8))}}, "is not the name of a map"),
        ({"mask": np.zeros((40, 40), np.uint8)}, "^mask: must be boolean"),
        ({"mask": np.zeros((4, 4), bool)}, "maps albedo, mask: mask.png has 4 x 4 px, albedo.png 40 x 40 px"),
        ({"mask": np.zeros((40, 40), bool)}, "excludes every pixel"),
        ({"seed": -1}, "^seed: must be a whole number"),
        ({"image": [np.zeros((40, 40), np.uint8)] * 2}, "^image: 2 pictures, of which it takes one"),
    ],
)
def test_wrong_requests_are_told(arguments: dict[str, Any], problem: str) -> None:
    arguments = {"image": np.zeros((40, 40), np.uint8), "size": 48, **arguments}
    with pytest.raises(texloom.InputError, match=problem) as caught:
        texloom.synthesize(**arguments)
    assert isinstance(caught.value, ValueError)
    assert "--" not in str(caught.value)


# -- run and plan


def test_a_missing_source_is_named_as_an_argument(rgb: np.ndarray) -> None:
    with pytest.raises(
        texloom.InputError, match=r"sources.region: required, as in sources=\{'region': 'picture.png'\}$"
    ):
        texloom.run("revise", {"texture": rgb, "exemplar": rgb})


def test_the_second_of_two_arrays_is_named_by_its_shape(rgb: np.ndarray) -> None:
    with pytest.raises(texloom.InputError, match=r"\(holes is array of shape \(8, 9\)\)$"):
        texloom.run("fill", {"picture": rgb, "holes": np.zeros((8, 9), np.uint8)})


def test_run_exports_and_gives_outputs(rgb: np.ndarray, tmp_path: Path) -> None:
    done = texloom.run("quilting", {"exemplar": rgb}, size=64, out="made")
    assert set(done.exports) == {"texture.exr", "texture.png", "scores.json"}
    assert all(path.exists() for path in done.exports.values())
    assert done.exports["texture.png"] == Path("made/texture.png")
    assert done["texture"].image.shape == (64, 64, 3)
    assert np.asarray(done["texture"].image).dtype == np.float32
    assert not done["texture"].image.wraps
    assert list(done) == ["tone", "texture", "scores"]
    assert "image" in dir(done["texture"])
    with pytest.raises(AttributeError, match="no output 'imag'"):
        _ = done["texture"].imag
    with pytest.raises(KeyError, match="no result of 'textur'; there are tone, texture, scores"):
        _ = done["textur"]
    assert (tmp_path / "cache" / "texloom" / "store" / "cache").is_dir()
    default = texloom.run("quilting", {"exemplar": rgb}, size=64)
    assert default.exports["texture.png"].parent == Path("exemplar_quilting")
    assert {path.name for path in tmp_path.iterdir()} == {"cache", "made", "exemplar_quilting"}


def test_run_shares_keys_and_store_with_the_command_line(rgb: np.ndarray, tmp_path: Path) -> None:
    PIL.Image.fromarray(rgb).save(tmp_path / "a.png")
    done = texloom.run("quilting", {"exemplar": "a.png"}, {"texture.block": 16}, size=(48, 64), seed=5, store="s")
    options = "--source exemplar=a.png --seed 5 --set texture.size=64x48 --set texture.block=16 --store s --out o"
    command = [sys.executable, "-m", "texloom", "run", "quilting", "--json", *options.split()]
    report = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    assert [step["state"] for step in report["steps"]] == ["cached"] * 3
    assert [step["key"] for step in report["steps"]] == [one.key for one in done.reports]


def test_several_pictures_are_one_source_in_their_order(rgb: np.ndarray, tmp_path: Path) -> None:
    """Arrays and paths; a wrong one is named by its number."""
    pictures = [rgb, rgb[::-1] // 2, tmp_path / "third.png"]
    PIL.Image.fromarray(255 - rgb).save(pictures[2])
    planned = texloom.plan("mix", {"exemplars": pictures}, size=48)
    assert len({step.item for step in planned if step.item}) == 3
    with pytest.raises(texloom.InputError, match=r"^sources\.exemplars\.1: a value of type int is not a picture"):
        texloom.plan("mix", {"exemplars": [rgb, 3]})


def test_an_image_with_maps_is_a_source(rgb: np.ndarray) -> None:
    image = Image.of(rgb)
    more = Image(np.dstack([image.pixels, image.pixels[..., 0]]), ("R", "G", "B", "wetness"))
    done = texloom.run("quilting", {"exemplar": more}, size=48)
    assert done["texture"].image.channels == more.channels
    assert np.array_equal(copied(more.pixels, done["texture"].match), done["texture"].image)


def test_several_seeds_are_a_set(rgb: np.ndarray) -> None:
    done = texloom.run("quilting", {"exemplar": rgb}, size=48, seeds=range(2))
    assert len(done.items) == 2
    first, second = (done[f"{item}/texture"].image for item in done.items)
    assert not np.array_equal(first, second)
    assert done["contact_sheet"].image.shape[2] == 3
    assert not done.problems
    assert f"{done.items[0]}/texture.png" in done.exports


def test_items_that_fail_are_told(rgb: np.ndarray, tmp_path: Path) -> None:
    (tmp_path / "set").mkdir()
    PIL.Image.fromarray(rgb).save(tmp_path / "set" / "good.png")
    (tmp_path / "set" / "bad.png").write_text("no picture")
    done = texloom.run("quilting", {"exemplar": "set/*.png"}, size=48)
    assert done.items == ["bad", "good"]
    assert "is not a picture" in done.problems["bad"]
    assert done["good/texture"].image.shape == (48, 48, 3)
    with pytest.raises(KeyError, match="is not a picture"):
        _ = done["bad/texture"]


def test_plan_runs_and_writes_nothing(rgb: np.ndarray, tmp_path: Path) -> None:
    arguments: dict[str, Any] = {"sources": {"exemplar": rgb}, "size": 48, "store": tmp_path / "s"}
    assert [step.state for step in texloom.plan("quilting", **arguments)] == ["run", "wait", "wait"]
    assert not list(tmp_path.iterdir())
    done = texloom.run("quilting", **arguments, out=tmp_path / "o")
    planned = texloom.plan("quilting", **arguments)
    assert [step.state for step in planned] == ["cached"] * 3
    assert [step.key for step in planned] == [report.key for report in done.reports]


@pytest.mark.parametrize("runner", ["threads", "processes"])
def test_all_runners_take_arrays(rgb: np.ndarray, runner: str) -> None:
    local = texloom.run("quilting", {"exemplar": rgb}, size=48, store="local")
    done = texloom.run("quilting", {"exemplar": rgb}, size=48, store="other", out="o", runner=runner, workers=1)
    assert np.array_equal(done["texture"].image, local["texture"].image)
    assert {report.state for report in done.reports} == {"ran"}


def test_stage_failures_name_the_step(rgb: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: Any, **__: Any) -> None:
        raise RuntimeError("out of luck")

    monkeypatch.setattr("texloom.stages.synthesis.stitching.quilting._Quilt", fails)
    with pytest.raises(texloom.StepFailedError, match="texture") as caught:
        texloom.synthesize(rgb, **FAST)
    assert "out of luck" in str(caught.value.__cause__)


def test_nothing_is_printed_unless_asked(rgb: np.ndarray, capfd: pytest.CaptureFixture[str]) -> None:
    texloom.synthesize(rgb, **FAST)
    assert capfd.readouterr() == ("", "")
    texloom.synthesize(rgb, **{**FAST, "seed": 9}, progress=True)
    printed = capfd.readouterr()
    assert printed.out == ""
    assert "texture" in printed.err


def test_progress_is_heard(rgb: np.ndarray) -> None:
    events: list[Event] = []
    texloom.synthesize(rgb, **FAST, progress=events.append)
    assert [event.kind for event in events if event.step == "texture"][:1] == ["started"]
    shares = [event.done for event in events if event.kind == "progress" and event.step == "texture"]
    assert shares == sorted(shares)
    assert shares[-1] == 1
    assert [event.text for event in events if event.kind == "finished"] == ["ran"] * 3


def test_it_works_while_an_event_loop_runs(rgb: np.ndarray) -> None:
    """As in a notebook."""
    import asyncio

    async def cell() -> Any:
        return texloom.synthesize(rgb, **FAST)

    assert asyncio.run(cell()).image.shape == (48, 64, 3)


def test_old_arrays_are_pruned(rgb: np.ndarray, tmp_path: Path) -> None:
    for source in (rgb, {"albedo": rgb}):
        texloom.run("quilting", {"exemplar": source}, size=48, store="s")
    filed = [path for path in (tmp_path / "s" / "sources").rglob("*") if path.is_file()]
    assert {path.suffix for path in filed} == {".png", ".yaml"}
    assert len(filed) == 3
    store = Store(tmp_path / "s")
    housekeeping.prune(store, 1)
    assert all(path.exists() for path in filed)
    housekeeping.prune(store, 0)
    assert not list((tmp_path / "s" / "sources").iterdir())


# -- the package


def test_import_is_light() -> None:
    heavy = "numpy,numba,prefect,pydantic,click,yaml,cv2,scipy"
    code = (
        f"import sys, texloom, texloom as t; dir(t); print([m for m in '{heavy}'.split(',') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=os.sep)
    assert done.stdout.strip() == "[]"


def test_the_version_is_that_of_the_distribution() -> None:
    assert texloom.__version__ == importlib.metadata.version("texloom")
    assert "__version__" in dir(texloom)


def test_public_names_are_there() -> None:
    for name in texloom.__all__:
        assert getattr(texloom, name) is not None
        assert name in dir(texloom)
    with pytest.raises(AttributeError, match="no attribute 'synthesise'"):
        _ = texloom.synthesise  # type: ignore[attr-defined]


def test_arrays_mean_what_files_mean(rgb: np.ndarray) -> None:
    assert Image.of(rgb).pixels == pytest.approx(linear_from_srgb(rgb / 255))


_MATRICES = """
import numpy as np
rng = np.random.default_rng(1)
import texloom
rgb = rng.integers(0, 256, (64, 64, 3), np.uint8)
from threadpoolctl import threadpool_info
threads = lambda: {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas" and "numpy" in pool["filepath"]}
before, during = threads(), set()
texloom.synthesize(rgb, method="quilting", size=64, store="s", progress=lambda event: during.update(threads() if event.kind == "progress" else ()))
print(max(before), during, threads() == before)
"""  # noqa: E501


def test_numpy_imported_first_computes_on_one_thread(tmp_path: Path) -> None:
    """BLAS has one thread while a stage computes, and what the host gave it afterwards."""
    pytest.importorskip("threadpoolctl")
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "2"}
    done = subprocess.run(
        [sys.executable, "-c", _MATRICES], capture_output=True, text=True, check=True, cwd=tmp_path, env=environment
    )
    assert done.stdout.split(maxsplit=1)[1].strip() == "{1} True"
