from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.surfaces import cylinder, square
from tests.synthetic import picture, smooth_noise
from texloom.pipelines.media.shapes import torus
from texloom.pipelines.media.writers.registry import WriteJob, write
from texloom.stages.analysis.similarity.appearance_stack import (
    AppearanceStack,
    AppearanceStackParams,
    appearance_stack,
)
from texloom.stages.analysis.surfaces.surface_charts import SurfaceChartsParams, surface_charts
from texloom.stages.analysis.surfaces.surface_direction import SurfaceDirectionParams, surface_direction
from texloom.stages.evaluation.surface_views import SurfaceViewsParams, surface_views
from texloom.stages.synthesis.per_pixel.on_surface import OnSurface, OnSurfaceParams, on_surface
from texloom.stages.synthesis.per_pixel.per_pixel import PerPixelParams, per_pixel
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.normals import NORMAL

Analysed = tuple[Image, AppearanceStack]


def analysed(image: Image) -> Analysed:
    return image, appearance_stack(image, AppearanceStackParams())


@pytest.fixture(scope="module")
def spots() -> Analysed:
    pixels = smooth_noise((40, 44, 3), 2.5, np.random.default_rng(3))
    return analysed(picture(pixels))


@pytest.fixture(scope="module")
def stripes() -> Analysed:
    """Dark and light rows."""
    rows = 0.5 + 0.4 * np.sin(2 * np.pi * np.arange(48) / 8)
    noise = smooth_noise((48, 48), 2.0, np.random.default_rng(3))
    return analysed(picture(rows[:, None] + 0.1 * noise))


def made(
    exemplar: Analysed,
    mesh: np.ndarray,
    size: tuple[int, int],
    inputs: dict[str, Any] | None = None,
    **params: Any,
) -> OnSurface:
    """With texture coordinates of the mesh; ``turn`` and ``field`` are of the direction."""
    image, stack = exemplar
    own = {name: params.pop(name) for name in ("turn", "field") if name in params}
    charts = surface_charts(mesh, SurfaceChartsParams(size=size, charts="own"))
    direction = surface_direction(charts.mesh, SurfaceDirectionParams(**own)).direction
    return on_surface(
        image, stack.appearance, stack.basis, stack.candidates, stack.toroidal, charts.mesh, charts.chart,
        direction, *size, OnSurfaceParams(**params), np.random.default_rng(5), **(inputs or {}),
    )  # fmt: skip


def planar(exemplar: Analysed, jacobian: np.ndarray, **params: Any) -> np.ndarray:
    """The correspondence of a flat result with the same random numbers."""
    image, stack = exemplar
    checked, rng = PerPixelParams(size=jacobian.shape[:2], **params), np.random.default_rng(5)
    parts = (stack.appearance, stack.basis, stack.candidates, stack.toroidal)
    return per_pixel(image, *parts, checked, rng, target_jacobian=jacobian).match


def test_a_torus_with_its_texture_coordinates_equals_a_tileable_result(spots: Analysed) -> None:
    one = made(spots, torus(48, 24), (64, 128), field="texture")
    assert one.covered.all()
    np.testing.assert_array_equal(one.match, planar(spots, one.jacobian, tileable=True, block=6))


def test_inside_a_flat_square_equals_a_flat_result(spots: Analysed) -> None:
    one = made(spots, square(160.0), (160, 160), texel_size=1.0)
    np.testing.assert_allclose(one.jacobian, np.broadcast_to([1, 0, 0, 1], (160, 160, 4)), atol=1e-5)
    inside = np.s_[64:-64, 64:-64]  # how far a border reaches in two levels
    np.testing.assert_array_equal(one.match[inside], planar(spots, one.jacobian, block=6)[inside])


@pytest.mark.parametrize("texel_size", [1e-300, 1e300])
def test_a_texel_size_out_of_proportion_is_refused(spots: Analysed, texel_size: float) -> None:
    with pytest.raises(InputError, match=r"texel_size: 1e.300 is out of proportion to a pixel of the result, 1 on"):
        made(spots, square(32.0), (32, 32), texel_size=texel_size)


def seam(image: Image, left: int, right: int) -> float:
    """Share of neighbouring columns that differ less than two others."""
    pixels = image.color.mean(axis=2)
    inside = np.abs(np.diff(pixels[:, left : right + 1], axis=1)).mean(axis=0)
    return float((inside < np.abs(pixels[:, left] - pixels[:, right]).mean()).mean())


@pytest.mark.parametrize("u", [(0, 1), (0.125, 0.875)])
def test_the_seam_of_a_cylinder_is_not_visible(spots: Analysed, u: tuple[float, float]) -> None:
    one = made(spots, cylinder(u), (64, 192))
    columns = np.flatnonzero(one.covered.all(axis=0))
    assert seam(one.image, int(columns[0]), int(columns[-1])) < 0.95


def test_pixels_at_the_same_place_of_the_surface_are_equal(spots: Analysed) -> None:
    """Two charts whose common border is in the middle of pixels."""
    size, middle = (64, 144), 64.5
    mesh = np.concatenate(
        [
            square(128.0, (0.5 / 144, middle / 144), (0, 0.5)),
            square(128.0, ((middle + 6) / 144, (2 * middle + 5.5) / 144), (0.5, 1)),
        ]
    )
    one = made(spots, mesh, size, texel_size=1.0)
    assert one.covered[:, 64].all()
    assert not one.covered[:, 67].any()
    np.testing.assert_array_equal(one.match[:, 64], one.match[:, 70])
    np.testing.assert_array_equal(one.image.pixels[:, 64], one.image.pixels[:, 70])


def test_beside_a_chart_the_texture_goes_on_as_in_the_other(spots: Analysed) -> None:
    size = (64, 144)
    mesh = np.concatenate([square(128.0, (0, 64 / 144), (0, 0.5)), square(128.0, (72 / 144, 136 / 144), (0.5, 1))])
    one = made(spots, mesh, size, texel_size=1.0)
    np.testing.assert_array_equal(one.match[:, 64], one.match[:, 72])
    np.testing.assert_array_equal(one.match[:, 71], one.match[:, 63])


@pytest.mark.parametrize(("turn", "axis"), [(0, 0), (90, 1), (180, 0)])
def test_texture_turns_with_its_direction(stripes: Analysed, turn: float, axis: int) -> None:
    pixels = made(stripes, square(96.0), (96, 96), texel_size=1.0, turn=turn).image.pixels[..., 0]
    change = [np.abs(np.diff(pixels, axis=one)).mean() for one in (0, 1)]
    assert change[axis] > 3 * change[1 - axis]


def test_texture_has_its_size_on_the_surface_whatever_the_texture_coordinates(stripes: Analysed) -> None:
    """Stretched to twice its height in the texture: 96 x 96 units on 192 x 96 px."""
    pixels = made(stripes, square(96.0), (192, 96), texel_size=1.0).image.pixels[..., 0]
    spectrum = np.abs(np.fft.rfft(pixels - pixels.mean(), axis=0)).mean(axis=1)
    assert abs(int(spectrum.argmax()) - 96 / 8) <= 1


def test_normals_turn_with_the_texture(stripes: Analysed) -> None:
    image, stack = stripes
    normals = np.broadcast_to(np.array([0.6, 0.0, 0.8], np.float32), (48, 48, 3))
    whole = Image(np.concatenate([image.pixels, normals], axis=2), ("Y", *NORMAL))
    for turn, wanted in ((0, (0.6, 0, 0.8)), (90, (0, 0.6, 0.8))):
        one = made((whole, stack), square(32.0), (32, 32), texel_size=1.0, turn=turn)
        np.testing.assert_allclose(one.image.pixels[..., 1:], np.broadcast_to(wanted, (32, 32, 3)), atol=1e-5)


def test_texture_that_repeats_stays_in_phase_across_charts() -> None:
    """Of spots in rows: what the result has of their period, with its phase, where the surface is in two charts."""
    rng = np.random.default_rng(2)
    wave = np.sin(2 * np.pi * np.arange(72) / 12)
    spots = 0.5 + 0.2 * (wave[:, None] + wave) + 0.1 * smooth_noise((72, 72), 1.5, rng)
    exemplar = analysed(picture(spots))
    mesh = np.concatenate([square(192.0, (0, 0.48), (0, 0.5)), square(192.0, (0.52, 1), (0.5, 1))])
    part = []
    for inputs in ({}, {"generators": np.array([[12, 0], [0, 12]], np.float32)}):
        pixels = made(exemplar, mesh, (192, 200), inputs, texel_size=1.0).image.pixels[..., 0]
        flat = np.concatenate([pixels[:, :96], pixels[:, 104:]], axis=1)
        turn = np.exp(2j * np.pi * np.arange(192) / 12)
        part.append(abs((flat - flat.mean()) @ turn).mean() / 192 / 0.1)
    assert part[0] < 0.7
    assert part[1] > 0.85


PLACEMENTS = {
    "as the other": [[1, 0], [0, 1]],
    "a quarter turn": [[0, -1], [1, 0]],
    "a half turn": [[-1, 0], [0, -1]],
    "mirrored": [[-1, 0], [0, 1]],
    "mirrored and turned": [[0, 1], [1, 0]],
}
"""of a chart in the texture: u and v by across and above on the surface"""


@pytest.mark.parametrize("placement", PLACEMENTS)
def test_light_is_the_same_on_both_sides_of_a_border(stripes: Analysed, placement: str, tmp_path: Path) -> None:
    """Of a tilted normal, in the report's views and with the tangents of the exported mesh."""
    _, stack = stripes
    tilted = np.concatenate([np.full((48, 48, 1), 0.5), np.broadcast_to([0.48, 0.36, 0.8], (48, 48, 3))], axis=2)
    whole = Image(tilted.astype(np.float32), ("Y", *NORMAL))
    left, right = square(64.0, (0, 0.48), (0, 0.5)), square(64.0, (0, 1), (0.5, 1))
    places = (right[:, 6:8] - 0.5) * [1, 0.5] @ np.array(PLACEMENTS[placement]).T
    right[:, 6:8] = [0.75, 0.5] + 0.48 * places
    mesh = np.concatenate([left, right])
    one = made((whole, stack), mesh, (64, 64), texel_size=1.0)
    mesh = surface_charts(mesh, SurfaceChartsParams(size=(64, 64), charts="own")).mesh
    views = surface_views(mesh, one.image, SurfaceViewsParams(views=1, tilt=0.0, side=64)).image.pixels[..., 0]
    lit = views[24:40, 16:48]
    np.testing.assert_allclose(lit, lit[0, 0], rtol=0.02)

    write(WriteJob(tmp_path / "mesh.glb", one.image, Image, {}, mesh=mesh))
    gltf = pytest.importorskip("pygltflib").GLTF2().load(str(tmp_path / "mesh.glb"))
    body = gltf.binary_blob()

    def values(index: int, width: int) -> np.ndarray:
        view = gltf.bufferViews[gltf.accessors[index].bufferView]
        return np.frombuffer(body[view.byteOffset : view.byteOffset + view.byteLength], np.float32).reshape(
            -1, width
        )

    attributes = gltf.meshes[0].primitives[0].attributes
    normal, tangent = values(attributes.NORMAL, 3), values(attributes.TANGENT, 4)
    texture = values(attributes.TEXCOORD_0, 2)
    rows, columns = np.clip(texture[:, ::-1] * 64 - 0.5, 0, 63).astype(int).T
    x, y, z = (one.image.pixels[rows, columns, number, None] for number in (1, 2, 3))
    world = x * tangent[:, :3] + y * np.cross(normal, tangent[:, :3]) * tangent[:, 3:] + z * normal
    np.testing.assert_allclose(world, np.tile([0.48, 0.36, 0.8], (len(world), 1)), atol=0.02)


def test_the_target_is_followed(spots: Analysed) -> None:
    image, _ = spots
    wanted = np.tile(np.linspace(0, 1, 96) > 0.5, (96, 1))
    control = picture((image.color.mean(axis=2) > 0.5).astype(np.float32))
    target = picture(wanted.astype(np.float32))
    one = made(spots, square(96.0), (96, 96), {"control": control, "target": target}, texel_size=1.0)
    light = one.image.color.mean(axis=2)
    assert light[wanted].mean() > light[~wanted].mean() + 0.1


@pytest.mark.parametrize("generators", [None, [[12, -4], [0, 16]]], ids=["free", "in phase"])
def test_any_number_of_threads_gives_the_same_bits(
    spots: Analysed,
    on_threads: Callable[[Callable[[], OnSurface]], tuple[OnSurface, OnSurface]],
    generators: list[list[float]] | None,
) -> None:
    inputs = {} if generators is None else {"generators": np.array(generators, np.float32)}
    one, other = on_threads(lambda: made(spots, cylinder((0.1, 0.8)), (96, 128), inputs))
    np.testing.assert_array_equal(one.image.pixels, other.image.pixels)
    np.testing.assert_array_equal(one.match, other.match)
