"""Recipes of several pictures: in a browser, and as the command line takes them."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import PIL.Image
import pydantic
import pytest
import yaml

from tests.studio.conftest import Watched, exemplar, repeated
from texloom.pipelines.engine.opening import open_run
from texloom.pipelines.flow.model import Each, Overrides
from texloom.pipelines.store.store import Store
from texloom.pipelines.studio.library import Library
from texloom.pipelines.studio.messages.answers import PreviewPicture
from texloom.pipelines.studio.messages.recipes import MOST_PICTURES, Recipe
from texloom.pipelines.studio.messages.requests import PreviewRequest
from texloom.pipelines.studio.previews import Previewer
from texloom.pipelines.studio.recipe_flows import described, open_recipe, overrides_of
from texloom.pipelines.studio.work import Places
from texloom.stages.vocabulary.declare import InputError

FLOWS = ("mix", "remix", "transition_tiles")
TWO = ("folder:waves.png", "folder:blotches.png")


@pytest.fixture
def library(tmp_path: Path) -> Library:
    folder = tmp_path / "project"
    (folder / "more").mkdir(parents=True)
    for name, picture in (("blotches", exemplar()), ("waves", waves()), ("more/waves", waves())):
        PIL.Image.fromarray(picture).save(folder / f"{name}.png")
    PIL.Image.fromarray(waves()).save(tmp_path / "outside.png")
    (folder / "link.png").symlink_to(tmp_path / "outside.png")
    return Library(folder, tmp_path / "store")


def waves() -> np.ndarray:
    """A picture of stripes, sRGB."""
    rows, columns = np.indices((64, 64))
    grey = 127 + 100 * np.sin(columns / 3 + np.sin(rows / 5))
    return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)


@pytest.mark.parametrize("flow", FLOWS)
def test_file_and_command_have_the_same_pictures_in_their_order(
    library: Library, tmp_path: Path, flow: str
) -> None:
    store = Store(tmp_path / "store")
    recipe = Recipe(flow=flow, sources={"exemplars": TWO}, params={"match_tone": 0.5})
    run = open_recipe(recipe, library, store)
    told = described(recipe, run, library)
    file = tmp_path / "again.yaml"
    file.write_text(told.yaml)
    again = open_run(str(file), Overrides(), store)
    paths = tuple(library.reference(one) for one in TWO)
    for opened in (run, again):
        source = opened.flow.sources["exemplars"]
        assert isinstance(source, Each)
        assert source.patterns == paths
        names = [item.name for item in opened.items]
        assert names == (["blotches", "waves"] if flow == "remix" else ["waves", "blotches"])
    assert {name: step.params for name, step in run.flow.steps.items()} == {
        name: step.params for name, step in again.flow.steps.items()
    }
    assert told.command.split()[3:5] == list(paths)
    assert told.file == f"{'_'.join(item.name for item in run.items)}_{flow}.yaml"


def test_each_picture_has_its_weight_by_the_name_of_the_flow(library: Library, tmp_path: Path) -> None:
    pictures = ("folder:waves.png", "folder:more/waves.png")
    recipe = Recipe(flow="remix", sources={"exemplars": pictures}, lists={"sheet.weights": (3, 1)})
    run = open_recipe(recipe, library, Store(tmp_path / "store"))
    weights = run.flow.steps["sheet"].params.weights  # type: ignore[attr-defined]
    assert set(weights) == {item.name for item in run.items}
    first = next(item for item in run.items if "more" not in item.sources["exemplars"])
    assert weights[first.name] == 3
    file = yaml.safe_load(described(recipe, run, library).yaml)
    assert file["steps"]["sheet"]["params"]["weights"] == weights


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"sources": {"exemplars": (*TWO, TWO[0])}}, r"sources.exemplars: waves.png is chosen twice"),
        ({"sources": {"exemplars": (TWO[0], "folder:gone.png")}}, "gone.png: is no longer there"),
        ({"sources": {"exemplars": (TWO[0], "folder:../outside.png")}}, "not in the folder of the studio"),
        ({"sources": {"exemplars": (TWO[0], "folder:link.png")}}, "not in the folder of the studio"),
        ({"sources": {"exemplars": (TWO[0], "/etc/passwd")}}, "no such picture"),
        ({"sources": {"exemplars": (TWO[0], "folder:*.png")}}, "is no longer there"),
        ({"sources": {"exemplars": (TWO[0], "folder:more")}}, "more is a folder of several; choose pictures"),
        ({"mask": TWO[0]}, "sources.exemplars: a mask is of one picture"),
        ({"lists": {"sheet.weights": (1, 2, 3)}}, "one number for each picture of 'exemplars', got 3"),
        ({"lists": {"sheet.nothing": (1,)}}, "nothing"),
    ],
)
def test_wrong_pictures_are_refused_in_one_line(
    library: Library, tmp_path: Path, change: dict[str, object], problem: str
) -> None:
    recipe = Recipe.model_validate({"flow": "mix", "sources": {"exemplars": TWO}, **change})
    with pytest.raises(InputError, match=problem) as refused:
        open_recipe(recipe, library, Store(tmp_path / "store"))
    assert str(refused.value).isprintable()


@pytest.mark.parametrize(
    "change",
    [
        {"sources": {"exemplars": ()}},
        {"sources": {"exemplars": TWO * MOST_PICTURES}},
        {"sources": {"exemplars": {"first": TWO[0]}}},
        {"lists": {"sheet.weights": (float("nan"), 1)}},
        {"lists": {"curve": (0.5,) * 65}},
        {"udim": "100x2"},
        {"params": {"variants": "2x0; rm"}},
    ],
)
def test_the_number_of_pictures_and_of_values_is_bounded(change: dict[str, object]) -> None:
    with pytest.raises(pydantic.ValidationError):
        Recipe.model_validate({"flow": "mix", "sources": {"exemplars": TWO}, **change})


def test_a_list_where_one_picture_is_taken_is_a_set_as_on_the_command_line(library: Library) -> None:
    given = overrides_of(Recipe(flow="quilting", sources={"exemplar": TWO}), library)
    assert given.sources == {"exemplar": tuple(library.reference(one) for one in TWO)}


def preview(recipe: Recipe, root: Path) -> PreviewPicture:
    """The last picture of a preview."""
    places = Places(folder=str(root / "project"), store=str(root / "store"), scratch=str(root / "scratch"))
    sent: list[PreviewPicture] = []
    Previewer(places).make(
        PreviewRequest(number=1, recipe=recipe), b"", lambda: None, lambda picture, _: sent.append(picture)
    )
    return sent[-1]


def test_previews_reduce_each_picture_under_its_name(library: Library, tmp_path: Path) -> None:
    pictures = []
    for name in ("waves", "more/waves"):
        large = PIL.Image.fromarray(waves()).resize((128, 120))
        large.save(library.roots["folder"] / f"{name}.png")
        pictures.append(f"folder:{name}.png")
    recipe = Recipe(
        flow="remix",
        sources={"exemplars": pictures},
        lists={"sheet.weights": (2, 1)},
        size=(64, 512),
        preset="fast",
    )
    shown = preview(recipe, tmp_path)
    assert shown.is_final
    assert shown.scale == 72 / 120
    assert (shown.height, shown.width) == (40, 308)


def test_previews_refuse_what_the_run_would(library: Library, tmp_path: Path) -> None:
    assert library.roots
    with pytest.raises(InputError, match=r"suits: image: blending would destroy its structure.*accept=true"):
        preview(Recipe(flow="endless", sources={"exemplar": "texloom:plaster"}), tmp_path)
    assert preview(
        Recipe(flow="endless", sources={"exemplar": "texloom:bricks"}), tmp_path
    ).is_final  # by its cells


def test_previews_of_a_photograph_show_its_surface_in_colour(library: Library, tmp_path: Path) -> None:
    PIL.Image.fromarray(np.tile(exemplar(), (2, 3, 1))).save(library.roots["folder"] / "wall.png")
    recipe = Recipe(
        flow="photo_material",
        sources={"photo": "folder:wall.png"},
        params={"plane": 0, "relief": 0.02},
        size=(64, 80),
        preset="fast",
    )
    shown = preview(recipe, tmp_path)
    assert shown.is_final
    assert (shown.height, shown.width) == (64, 80)


def test_two_dropped_pictures_are_mixed_as_in_a_terminal(watched: Watched, tmp_path: Path) -> None:
    page = watched.page
    for name, picture in (("stripes", waves()), ("spots", exemplar()[::-1])):
        PIL.Image.fromarray(picture).save(tmp_path / f"{name}.png")
    page.get_by_role("button", name="blotches").first.click()
    page.get_by_label("Method").select_option("mix")
    settings = page.get_by_label("Settings")
    page.get_by_role("status").filter(has_text="Choose: two pictures or more").wait_for()
    assert settings.get_by_role("button", name="Finish at full size").is_disabled()
    settings.get_by_label("Preset").select_option("fast")
    settings.get_by_label("Border", exact=True).select_option("one clear line")
    for side, length in (("Height", "48"), ("Width", "64")):
        page.get_by_label(side).fill(length)
        page.get_by_label(side).press("Enter")
    page.locator("make-view").get_by_label("Choose pictures").set_input_files(
        [tmp_path / "stripes.png", tmp_path / "spots.png"]
    )
    settings.get_by_role("button", name="Remove spots").wait_for()
    settings.get_by_role("button", name="Remove blotches").press("Enter")
    settings.get_by_role("button", name="Move spots up").press("Enter")
    page.wait_for_function("() => document.activeElement.ariaLabel === 'Move spots down'")
    assert settings.locator("several-pictures li").all_inner_texts()[0].split()[0] == "spots"
    settings.get_by_text("spots is number 1 of 2").wait_for(state="attached")
    settings.get_by_role("button", name="Paint map").click()
    settings.locator("map-painter canvas").press("Space")
    settings.get_by_label("Map", exact=True).locator("option", has_text="painted").wait_for(state="attached")
    page.get_by_role("status").filter(has_text="Preview").wait_for()
    flow = yaml.safe_load(repeated(settings, tmp_path))
    assert [Path(one).stem for one in flow["sources"]["exemplars"]["each"]] == ["spots", "stripes"]
    assert Path(flow["sources"]["map"]).name == "painted_map.png"
    assert flow["steps"]["mixture"]["params"] == {"size": "64x48", "patchiness": 0}
    page.get_by_role("radio", name="Which picture").click()
    page.wait_for_function("() => document.querySelector('make-view').made.results.picture.width === 64")
    with page.expect_download() as whole:
        settings.get_by_role("link", name="origin.png").click()
    assert whole.value.suggested_filename == "spots_stripes_mix_origin.png"
    job = page.evaluate("() => document.querySelector('make-view').made.results.job")
    status, content = watched.served.request(f"/api/jobs/{job['id']}/all")
    assert status == 200
    assert set(zipfile.ZipFile(io.BytesIO(content)).namelist()) == set(job["files"])
    assert watched.served.request("/api/jobs/none/all")[0] == 404
    page.get_by_label("Method").select_option("quilting")
    assert settings.locator("several-pictures").count() == 0


DROP = """pictures => {
  const data = new DataTransfer();
  for (const [name, codes] of pictures) data.items.add(new File([Uint8Array.from(codes)], name));
  return data;
}"""


def test_two_loose_files_on_an_empty_page_are_two_pictures(watched: Watched, tmp_path: Path) -> None:
    """Nothing is chosen yet: both are there, the first one is used, and a method of several takes both."""
    page = watched.page
    dropped = []
    for name, picture in (("lava", waves()), ("frost", exemplar()[::-1])):
        PIL.Image.fromarray(picture).save(tmp_path / f"{name}.png")
        dropped.append([f"{name}.png", list((tmp_path / f"{name}.png").read_bytes())])
    data = page.evaluate_handle(DROP, dropped)
    page.locator("section.stage").locator("visible=true").first.dispatch_event("drop", {"dataTransfer": data})
    page.get_by_role("button", name="lava", pressed=True).wait_for()
    assert page.get_by_role("button", name="frost", pressed=False).count() == 1
    # asked first whether they are the maps of one material, which the browser reports itself
    watched.problems = [one for one in watched.problems if "422" not in one]
    page.get_by_label("Method").select_option("remix")
    page.get_by_role("button", name="frost").first.click()
    listed = page.locator("several-pictures li")
    listed.nth(1).wait_for()
    assert [one.split()[0] for one in listed.all_inner_texts()] == ["lava", "frost"]


def test_a_way_that_is_drawn_or_clicked_becomes_the_map(watched: Watched) -> None:
    page = watched.page
    page.get_by_role("button", name="blotches").first.click()
    page.get_by_label("Method").select_option("grow")
    settings = page.get_by_label("Settings")
    settings.get_by_role("button", name="Paint trend of the result").click()
    settings.get_by_role("radio", name="Way").click()
    canvas = settings.locator("map-painter canvas")
    box = canvas.bounding_box()
    codes = "() => Array.from(document.querySelector('map-painter').map.codes)"
    sides = page.evaluate(
        "() => [document.querySelector('map-painter').map.height, document.querySelector('map-painter').map.width]"
    )
    side = min(box["width"], box["height"])
    left, top = box["x"] + (box["width"] - side) / 2, box["y"] + (box["height"] - side) / 2
    across = [(left + share * side, top + side / 2) for share in (0.9, 0.5, 0.1)]
    page.mouse.move(*across[0])
    page.mouse.down()
    for place in across[1:]:
        page.mouse.move(*place, steps=10)
    page.mouse.up()
    settings.get_by_label("Trend of the result", exact=True).locator("option", has_text="painted").wait_for(
        state="attached"
    )
    drawn = np.array(page.evaluate(codes)).reshape(sides)
    assert (drawn[:, 0] > 230).all()
    assert (drawn[:, -1] < 25).all()  # from right to left
    assert (np.diff(drawn, axis=1) <= 0).all()
    settings.get_by_role("button", name="Another way").click()
    canvas.focus()
    for keys in ("Shift+ArrowUp", "Shift+ArrowDown"):
        for _ in range(12):
            page.keyboard.press(keys)
        page.keyboard.press("Space")
    page.wait_for_function(
        f"before => JSON.stringify(({codes})()) !== before", arg=str(drawn.ravel().tolist()).replace(" ", "")
    )
    clicked = np.array(page.evaluate(codes)).reshape(sides)
    assert (np.diff(clicked.astype(int), axis=0) >= 0).all()
    assert clicked[0, 0] < 25
