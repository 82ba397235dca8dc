"""The nodes for ComfyUI, run as it runs them: its example workflows on a stand-in for its tensors and modules."""

from __future__ import annotations

import importlib.util
import json
import shutil
import sys
import types
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.bridge.conftest import COMMAND
from tests.conftest import ROOT
from tests.studio.conftest import exemplar
from texloom.pipelines.bridge import client as client_file

NODES = ROOT / "hosts" / "comfyui"
SIZE = 64


class Tensor:
    """What the nodes use of a tensor of torch."""

    def __init__(self, values: np.ndarray):
        self._values = values
        self.shape = values.shape

    def __iter__(self) -> Iterator[Tensor]:
        return (Tensor(one) for one in self._values)

    def cpu(self) -> Tensor:
        return self

    def numpy(self) -> np.ndarray:
        return self._values

    def reshape(self, shape: tuple[int, ...]) -> Tensor:
        return Tensor(self._values.reshape(shape))


class Interrupted(Exception):  # noqa: N818 (as ComfyUI calls it)
    pass


class Blocker:
    def __init__(self, message: str):
        self.message = message


class Host:
    """What the nodes use of ComfyUI."""

    def __init__(self) -> None:
        self.is_interrupted = False
        self.shown: list[tuple[int, int, Any]] = []

    def modules(self) -> dict[str, types.ModuleType]:
        host = self

        class ProgressBar:
            def __init__(self, total: int):
                self.total = total

            def update_absolute(self, value: int, total: int | None = None, preview: Any = None) -> None:
                host.shown.append((value, self.total, preview))

        def throw_exception_if_processing_interrupted() -> None:
            if host.is_interrupted:
                raise Interrupted

        contents: dict[str, dict[str, Any]] = {
            "torch": {"from_numpy": Tensor},
            "comfy": {},
            "comfy.utils": {"ProgressBar": ProgressBar},
            "comfy.model_management": {
                "throw_exception_if_processing_interrupted": throw_exception_if_processing_interrupted
            },
            "comfy_execution": {},
            "comfy_execution.graph_utils": {"ExecutionBlocker": Blocker},
        }
        made = {name: types.ModuleType(name) for name in contents}
        for name, values in contents.items():
            vars(made[name]).update(values)
            parent, _, child = name.rpartition(".")
            if parent:
                setattr(made[parent], child, made[name])
        return made


@pytest.fixture(scope="module")
def comfy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Host, Any]]:
    """The host and the package of nodes, laid out as docs/bridge.md says."""
    folder = tmp_path_factory.mktemp("custom_nodes") / "texloom"
    shutil.copytree(NODES, folder)
    shutil.copy(client_file.__file__, folder / "texloom_client.py")
    host = Host()
    with pytest.MonkeyPatch.context() as patched:
        for name, module in host.modules().items():
            patched.setitem(sys.modules, name, module)
        spec = importlib.util.spec_from_file_location("comfy_texloom", folder / "__init__.py")
        assert spec is not None
        assert spec.loader is not None
        package = importlib.util.module_from_spec(spec)
        patched.setitem(sys.modules, "comfy_texloom", package)
        spec.loader.exec_module(package)
        running = sys.modules["comfy_texloom.running"]
        running._CLIENT.close()
        with running.Client(COMMAND, store=str(folder.parent / "store")) as client:
            patched.setattr(running, "_CLIENT", client)
            yield host, package
        for name in [one for one in sys.modules if one.startswith("comfy_texloom")]:
            patched.delitem(sys.modules, name)


def loaded(*pictures: np.ndarray) -> Tensor:
    """As LoadImage gives them."""
    return Tensor(np.stack([one.astype(np.float32) / 255.0 for one in pictures]))


def hole() -> Tensor:
    values = np.zeros((1, SIZE, SIZE), np.float32)
    values[:, 20:40, 24:44] = 1
    return Tensor(values)


def ramp() -> Tensor:
    """From left to right, from 0 to 1 in the middle half."""
    columns = np.clip(np.linspace(-0.5, 1.5, SIZE, dtype=np.float32), 0, 1)
    return Tensor(np.tile(columns, (1, SIZE, 1)))


def inputs_of(name: str) -> Tensor:
    """A picture of the workflows by its name."""
    picture = exemplar()
    grey = picture.mean(axis=2, keepdims=True).astype(np.uint8).repeat(3, 2)
    second = np.stack([255 - picture[..., 0], picture[..., 1] // 4, picture[..., 2] // 4], axis=2)
    others = {
        "second.png": second,
        "normal.png": np.full_like(picture, (128, 128, 255)),
        "roughness.png": grey[::-1],
        "height.png": grey,
    }
    return loaded(others.get(name, picture))


def run_workflow(name: str, package: Any) -> dict[str, Any]:
    """Run an example; what is saved, by the name of its file."""
    nodes = json.loads((NODES / "example_workflows" / f"{name}.json").read_text())
    made: dict[str, tuple[Any, ...]] = {}
    saved = {}
    for identity in sorted(nodes, key=int):
        kind, given = nodes[identity]["class_type"], nodes[identity]["inputs"]
        given = {key: made[one[0]][one[1]] if isinstance(one, list) else one for key, one in given.items()}
        if kind == "LoadImage":
            made[identity] = (inputs_of(given["image"]),)
        elif kind == "LoadImageMask":
            made[identity] = (ramp() if given["image"] == "map.png" else hole(),)
        elif kind == "SaveImage":
            saved[given["filename_prefix"]] = given["images"]
        else:
            node = package.NODE_CLASS_MAPPINGS[kind]
            accepted = node.INPUT_TYPES()
            asked = {**accepted["required"], **accepted.get("optional", {})}
            assert len(asked) == sum(map(len, accepted.values()))  # no name twice
            assert set(accepted["required"]) <= set(given) <= set(asked)
            choices = {key: asked[key][0] for key in given if isinstance(asked[key][0], list)}
            assert all(given[key] in choice for key, choice in choices.items())
            given |= {key: SIZE for key in ("width", "height") if key in given}
            made[identity] = getattr(node(), node.FUNCTION)(**given)
            assert len(made[identity]) == len(node.RETURN_TYPES)
    return saved


def values_of(image: Any) -> np.ndarray:
    values: np.ndarray = image.numpy()
    assert values.dtype == np.float32
    assert values.ndim == 4
    assert values.shape[3] == 3
    assert 0 <= values.min() <= values.max() <= 1
    return values


def test_larger(comfy: tuple[Host, Any]) -> None:
    host, package = comfy
    host.shown.clear()
    (made,) = run_workflow("larger_and_tileable", package).values()
    assert values_of(made).shape == (1, SIZE, SIZE, 3)
    assert all(0 <= value <= total for value, total, _ in host.shown)


def test_make_tileable(comfy: tuple[Host, Any]) -> None:
    (made,) = run_workflow("make_tileable", comfy[1]).values()
    before = exemplar().astype(np.float32) / 255.0
    np.testing.assert_array_equal(values_of(made)[0, 20:44, 20:44], before[20:44, 20:44])
    assert (values_of(made)[0, 0] != before[0]).any()


def test_fill_and_revise(comfy: tuple[Host, Any]) -> None:
    saved = run_workflow("fill_and_revise", comfy[1])
    before = exemplar().astype(np.float32) / 255.0
    inside = hole().numpy()[0] > 0
    filled, revised = (values_of(one)[0] for one in saved.values())
    for one in (filled, revised):
        np.testing.assert_array_equal(one[~inside], before[~inside])
        assert (one[inside] != before[inside]).any()
    assert (filled != revised).any()


def reddish(image: Any) -> np.ndarray:
    """Where each picture is from the second exemplar, whose green and blue are at most a quarter."""
    is_red: np.ndarray = values_of(image)[..., 1:].max(3) < 0.26
    return is_red


def test_remix(comfy: tuple[Host, Any]) -> None:
    """Twice as much of the first as of the second."""
    (made,) = run_workflow("remix", comfy[1]).values()
    assert values_of(made).shape == (1, SIZE, SIZE, 3)
    assert 0.2 < reddish(made).mean() < 0.47


def test_remix_takes_batches_and_sizes(comfy: tuple[Host, Any]) -> None:
    node = comfy[1].NODE_CLASS_MAPPINGS["TexloomRemix"]()
    asked = {
        name: default[1]["default"]
        for name, default in node.INPUT_TYPES()["required"].items()
        if name[-6:] == "weight"
    }
    first = inputs_of("example.png")
    both = Tensor(np.concatenate([first.numpy(), first.numpy()[:, ::-1]]))
    third = Tensor(inputs_of("second.png").numpy()[:, :40, :48])
    how = {"match_tone": 0.0, "width": 96, "height": 64, "tileable": "off", "preset": "fast", "seed": 7}
    (made,) = node.make(first=both, second=first, third=third, **asked, **how)
    assert values_of(made).shape == (1, 64, 96, 3)
    assert 0.15 < reddish(made).mean() < 0.5


def test_mix(comfy: tuple[Host, Any]) -> None:
    by_mask, by_angle = (reddish(one)[0] for one in run_workflow("mix", comfy[1]).values())
    assert by_mask.shape == by_angle.shape == (SIZE, SIZE)
    for along in (by_mask.T, by_angle):  # from left to right, from the top to the bottom
        assert along[:10].mean() < 0.3
        assert along[-10:].mean() > 0.6


def test_material(comfy: tuple[Host, Any]) -> None:
    """The maps that come later lie as the albedo does: here the height is the same picture."""
    saved = run_workflow("material", comfy[1])
    maps = {name.rpartition("/")[2]: values_of(one) for name, one in saved.items()}
    assert maps.keys() == {"albedo", "normal", "roughness", "height"}
    assert {one.shape for one in maps.values()} == {(1, SIZE, SIZE, 3)}
    albedo, height = (maps[name][0].mean(axis=2).ravel() for name in ("albedo", "height"))
    assert np.corrcoef(albedo, height)[0, 1] > 0.8  # heights are levelled at seams
    assert np.abs(maps["normal"][0] - (0.5, 0.5, 1)).max() < 0.02


def test_a_map_that_was_not_given_blocks_what_follows(comfy: tuple[Host, Any]) -> None:
    node = comfy[1].NODE_CLASS_MAPPINGS["TexloomMaterial"]()
    made = node.make(
        albedo=loaded(exemplar()), width=SIZE, height=SIZE, tileable="both", preset="fast", seed=7, green="up"
    )
    outputs = dict(zip(node.RETURN_NAMES, made, strict=True))
    assert values_of(outputs["albedo"]).shape == (1, SIZE, SIZE, 3)
    assert outputs["roughness"].message == "texloom: no roughness was given"


def test_a_batch(comfy: tuple[Host, Any]) -> None:
    """Each picture has the next seed, also where two are the same."""
    node = comfy[1].NODE_CLASS_MAPPINGS["TexloomSynthesise"]()
    how = {
        "width": 48, "height": 32, "tileable": "off", "method": "quilting", "preset": "default", "seed": 3,
    }  # fmt: skip
    both, results = node.make(exemplar=loaded(exemplar(), exemplar()), **how)
    second, _ = node.make(exemplar=loaded(exemplar()), **(how | {"seed": 4}))
    assert values_of(both).shape == (2, 32, 48, 3)
    np.testing.assert_array_equal(values_of(both)[1], values_of(second)[0])
    assert (values_of(both)[0] != values_of(both)[1]).any()
    assert [one[:4] for one in results] == [b"v/1\x01"] * 2  # OpenEXR


def test_levels_are_kept(comfy: tuple[Host, Any], caplog: pytest.LogCaptureFixture) -> None:
    running = sys.modules["comfy_texloom.running"]
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, 2)
    (eight,) = running.pictures(loaded(levels))
    np.testing.assert_array_equal(eight, levels)
    (deep,) = running.pictures(Tensor(np.linspace(0, 1, 48, dtype=np.float32).reshape(1, 4, 4, 3)))
    assert deep.dtype == np.uint16
    assert not caplog.records
    np.testing.assert_array_equal(running.grey(levels, "height"), levels[..., 0])
    assert not caplog.records
    running.grey(levels + np.arange(3, dtype=np.uint8), "height")
    assert "height: its channels differ by up to " in caplog.text
    (clipped,) = running.pictures(Tensor(np.full((1, 2, 2, 3), 1.5, np.float32)))
    assert (clipped == 255).all()
    assert "values beyond 0..1 are clipped" in caplog.text


def test_interruption(comfy: tuple[Host, Any]) -> None:
    host, package = comfy
    running = sys.modules["comfy_texloom.running"]
    node = package.NODE_CLASS_MAPPINGS["TexloomSynthesise"]()
    how = {"width": 1024, "height": 1024, "tileable": "both", "method": "self_tuning", "preset": "default"}
    runs = []
    submit = running._CLIENT.submit
    host.is_interrupted = True
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(running._CLIENT, "submit", lambda *one, **two: runs.append(submit(*one, **two)) or runs[0])
        with pytest.raises(Interrupted):
            node.make(exemplar=loaded(exemplar()), seed=11, **how)
    host.is_interrupted = False
    with pytest.raises(running.RunHandle.__init__.__globals__["CancelledError"]):
        runs[0].wait(60)


@pytest.mark.parametrize(
    ("kind", "given", "problem"),
    [
        ("TexloomFill", {"mask": Tensor(np.ones((2, 8, 8)))}, "mask: 2 given for 1 pictures; give one, or as many"),
        (
            "TexloomFill",
            {"mask": Tensor(np.zeros((8, 8)))},
            "mask: 8 x 8 px; must have the size of the image, 64 x 64 px",
        ),
    ],
)
def test_what_is_refused(comfy: tuple[Host, Any], kind: str, given: dict[str, Any], problem: str) -> None:
    node = comfy[1].NODE_CLASS_MAPPINGS[kind]()
    with pytest.raises(Exception, match=problem) as raised:
        node.make(image=loaded(exemplar()), preset="fast", seed=1, **given)
    assert "\n" not in str(raised.value)
