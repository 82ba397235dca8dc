import cv2
import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.analysis.structure.contour_cells import ContourCells
from texloom.stages.analysis.structure.ground_objects import GroundObjects
from texloom.stages.common.grids.border import Border
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.initialise import InitialiseParams, initialise
from texloom.stages.synthesis.optimisation.object_completion import ObjectCompletion
from texloom.stages.synthesis.optimisation.optimise import optimise
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.synthesis.optimisation.several_cells import completion_of
from texloom.stages.vocabulary.color import linear_from_lab
from texloom.stages.vocabulary.facts import NOWHERE, Wraps

SIZE, GROUND, DISC = 8, 30, 80
BORDER = Border(1)


def discs(
    rng: np.random.Generator, shape: tuple[int, int] = (140, 160), count: int = 30
) -> tuple[np.ndarray, np.ndarray]:
    """Light discs of 7 to 10 px apart on dark ground: lightness and colour, and its contours."""
    lightness = GROUND + rng.normal(0, 1, shape).astype(np.float32)
    placed: list[tuple[float, float, float]] = []
    for _ in range(4000):
        radius = float(rng.uniform(7, 10))
        row, column = rng.uniform(radius + 2, np.array(shape) - radius - 2)
        if all(np.hypot(row - y, column - x) > radius + r + 5 for y, x, r in placed):
            placed.append((row, column, radius))
    down, across = np.indices(shape)
    for row, column, radius in placed[:count]:
        lightness[np.hypot(down - row, across - column) <= radius] = DISC
    edges = cv2.morphologyEx((lightness > 55).astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    lab = np.stack([lightness, 0 * lightness, 0 * lightness], axis=2).astype(np.float32)
    return lab, cv2.GaussianBlur(edges.astype(np.float32), (0, 0), 1)


def unlike_discs(lightness: np.ndarray) -> int:
    """Light objects apart from the border that no disc of 6 to 11 px explains."""
    light = (lightness > 55).astype(np.uint8)
    count, _, boxes, _ = cv2.connectedComponentsWithStats(light, connectivity=4)
    wrong = 0
    for left, top, width, height, area in boxes[1:count]:
        if left == 0 or top == 0 or left + width == light.shape[1] or top + height == light.shape[0]:
            continue
        round_ = abs(width - height) <= 2 and abs(area - np.pi * width * height / 4) < 0.08 * area
        wrong += not (round_ and 12 <= width <= 23)
    return wrong


def shown(match: np.ndarray, lab: np.ndarray) -> np.ndarray:
    return lab[match[0] + SIZE // 2, match[1] + SIZE // 2, 0]


def joined(places: tuple[int, int]) -> np.ndarray:
    """The exemplar, and parts of it moved along lines that cross discs."""
    match = np.indices(places).astype(np.int32)
    match[0, :, 50:95] = (match[0, :, 50:95] + 24) % places[0]
    match[1, 60:] = (match[1, 60:] + 41) % places[1]
    return match


def completion(lab: np.ndarray, strength: np.ndarray, allowed: Allowed | None = None) -> ObjectCompletion:
    found = completion_of(GroundObjects(ContourCells(strength, BORDER), lab), lab, SIZE, allowed)
    assert isinstance(found, ObjectCompletion)
    return found


@pytest.fixture
def exemplar(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return discs(rng)


def test_discs_on_a_ground_are_objects(exemplar: tuple[np.ndarray, np.ndarray]) -> None:
    lab, strength = exemplar
    objects = GroundObjects(ContourCells(strength, BORDER), lab)
    assert objects.clear
    count, _ = cv2.connectedComponents((lab[..., 0] > 55).astype(np.uint8))
    assert objects.whole.sum() == count - 1
    assert (lab[objects.core, 0] > 55).all()


def test_cells_of_the_colour_of_the_ground_are_no_objects(exemplar: tuple[np.ndarray, np.ndarray]) -> None:
    """A line encloses some of it."""
    lab, strength = exemplar
    before = GroundObjects(ContourCells(strength, BORDER), lab).core
    strength = strength.copy()
    cv2.rectangle(strength, (20, 20), (70, 70), float(strength.max()), 1)
    assert ContourCells(strength, BORDER).core.sum() > before.sum() * 1.1
    after = GroundObjects(ContourCells(strength, BORDER), lab).core
    assert (lab[after, 0] > 55).all()


def test_two_halves_of_an_object_are_one(exemplar: tuple[np.ndarray, np.ndarray]) -> None:
    lab, strength = exemplar
    strength = strength.copy()
    objects = GroundObjects(ContourCells(strength, BORDER), lab)
    top, left, bottom, right = objects.boxes[np.flatnonzero(objects.whole)[0]]
    strength[top - 2 : bottom + 2, (left + right) // 2] = strength.max()
    cells = ContourCells(strength, BORDER)
    assert cells.whole.sum() == objects.whole.sum() + 1
    assert GroundObjects(cells, lab).whole.sum() == objects.whole.sum()


@pytest.mark.parametrize("kind", ["noise", "flat", "filled"])
def test_exemplars_without_objects_are_not_clear(kind: str, rng: np.random.Generator) -> None:
    down, across = np.indices((96, 96))
    strength = {
        "noise": rng.random((96, 96)),
        "flat": np.zeros((96, 96)),
        "filled": ((down % 12 == 0) | (across % 12 == 0)).astype(float),
    }[kind].astype(np.float32)
    lab = rng.normal(50, 5, (96, 96, 3)).astype(np.float32)
    assert not GroundObjects(ContourCells(strength, BORDER), lab).clear


def test_fused_and_cut_objects_become_whole(exemplar: tuple[np.ndarray, np.ndarray]) -> None:
    lab, strength = exemplar
    match = joined((133, 153))
    before = unlike_discs(shown(match, lab))
    assert before >= 6
    assert completion(lab, strength).complete(match, NOWHERE) >= 5
    assert unlike_discs(shown(match, lab)) <= before // 4
    assert (match >= 0).all()
    assert (match.max(axis=(1, 2)) <= np.array(lab.shape[:2]) - SIZE).all()


def test_whole_objects_stay(exemplar: tuple[np.ndarray, np.ndarray]) -> None:
    lab, strength = exemplar
    match = np.indices((133, 153)).astype(np.int32)
    before = match.copy()
    assert completion(lab, strength).complete(match, NOWHERE) == 0
    assert np.array_equal(match, before)


def test_a_stub_that_no_object_fits_is_removed(exemplar: tuple[np.ndarray, np.ndarray]) -> None:
    """Objects everywhere but the ground beside it are whole, and none is so small."""
    lab, strength = exemplar
    found = completion(lab, strength)
    boxes = found.cells.boxes[found.whole]
    box = boxes[np.flatnonzero(((boxes[:, :2] > 30) & (boxes[:, 2:] < 100)).all(axis=1))[0]] - SIZE // 2
    beside = np.argwhere(found.ground)[0] - SIZE // 2
    match = np.indices((133, 153)).astype(np.int32)
    match[:, box[0] - 4 : box[2] + 4, box[1] + 3 : box[3] + 4] = beside[:, None, None]
    before = shown(match, lab)
    found.complete(match, NOWHERE)
    assert unlike_discs(shown(match, lab)) == unlike_discs(before) - 1


@pytest.mark.parametrize("wrap", [NOWHERE, Wraps(False, True)])
def test_objects_across_a_border_that_wraps_become_whole(
    wrap: Wraps, exemplar: tuple[np.ndarray, np.ndarray]
) -> None:
    lab, strength = exemplar
    match = np.indices((133, 100)).astype(np.int32)
    before = unlike_discs(shown(np.roll(match, 50, axis=2), lab))
    assert before >= 3
    completion(lab, strength).complete(match, wrap)
    after = unlike_discs(shown(np.roll(match, 50, axis=2), lab))
    assert after <= before // 3 if wrap.across else after == before


def test_only_allowed_patches_are_used(exemplar: tuple[np.ndarray, np.ndarray]) -> None:
    lab, strength = exemplar
    usable = np.ones(lab.shape[:2], bool)
    usable[60:80, 60:80] = False
    allowed = Allowed(usable, *lab.shape[:2], SIZE)
    match = allowed.moved(joined((133, 153)))
    completion(lab, strength, allowed).complete(match, NOWHERE)
    assert allowed.places[tuple(match)].all()


def test_same_bits_on_any_number_of_threads(
    exemplar: tuple[np.ndarray, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    lab, strength = exemplar
    results = []
    for threads in ("1", "2"):
        monkeypatch.setenv("TEXLOOM_THREADS", threads)
        match = joined((133, 153))
        completion(lab, strength).complete(match, NOWHERE)
        results.append(match)
    assert np.array_equal(*results)


def naive_shares(found: ObjectCompletion, source: np.ndarray) -> list[float]:
    """The share that is wrong of each object away from the border whose outline is not compared, pixel by pixel."""
    cells = found.cells
    core = cells.core[source[0], source[1]]
    count, number = cv2.connectedComponents(core.astype(np.uint8), connectivity=4)
    shares = []
    for index in range(1, count):
        pixels = {(int(y), int(x)) for y, x in np.argwhere(number == index)}
        kinds: dict[tuple[int, int, int], int] = {}
        for y, x in pixels:
            v, u = source[:, y, x].tolist()
            kind = int(cells.label[v, u]), v - y, u - x
            kinds[kind] = kinds.get(kind, 0) + 1
        label, down, across = min(kinds, key=lambda kind: (-kinds[kind], kind))
        whole = {(int(v) - down, int(u) - across) for v, u in np.argwhere(cells.core & (cells.label == label))}
        inside = {(y, x) for y, x in whole if 0 <= y < core.shape[0] and 0 <= x < core.shape[1]}
        tones = found.smooth.astype(int)
        unlike = sum(
            int(np.abs(tones[tuple(source[:, y, x])] - tones[y + down, x + across]).max() > 9 * 8 * 10)
            for y, x in pixels & whole
        )
        shares.append((len(pixels ^ inside) + unlike) / len(whole))
    return shares


def test_shares_that_are_wrong(exemplar: tuple[np.ndarray, np.ndarray], monkeypatch: pytest.MonkeyPatch) -> None:
    found = completion(*exemplar)
    monkeypatch.setattr(found, "_outline_differs", lambda inside: np.inf)
    source = joined((133, 153)).astype(np.int64) + SIZE // 2
    monkeypatch.setattr(found, "_unlike", lambda *_: 0.0)
    _, shares = found._judged(found.cells.core[source[0], source[1]], source)
    expected = naive_shares(found, source)
    assert len(shares) == len(expected) + 1
    np.testing.assert_allclose(shares[1:], expected, rtol=1e-12)
    assert (shares > 0.15).sum() >= 5


def test_what_looks_otherwise(exemplar: tuple[np.ndarray, np.ndarray]) -> None:
    """Of an object of which the result shows half, at each of some displacements."""
    found = completion(*exemplar)
    label = int(found.whole[7])
    source = joined((133, 153)).astype(np.int64) + SIZE // 2
    tones = found.smooth.astype(int)
    body = np.argwhere((found.cells.label == label) & ~found.line)
    for shift in ([4, 4], [-20, 9], [28, 4]):
        inside = [(y - shift[0], x - shift[1]) for y, x in body]
        inside = [(y, x) for y, x in inside if 0 <= y < 133 and 0 <= x < 153]
        differs = [
            np.abs(tones[tuple(source[:, y, x])] - tones[y + shift[0], x + shift[1]]).max() > 9 * 8 * 10
            for y, x in inside
        ]
        assert found._unlike(label, np.array(shift), source) == sum(differs) / max(1, len(differs))


def test_the_result_of_the_optimisation_has_whole_objects(rng: np.random.Generator) -> None:
    """Objects that cover too little to be taken for cells, as flowers on paper do."""
    lab, strength = discs(rng, (128, 128), 18)
    cells = ContourCells(strength, Border(10))
    assert not cells.clear
    image = picture(linear_from_lab(lab))
    start = initialise(image, InitialiseParams(size=(256, 256)), np.random.default_rng(3)).match
    faults = []
    for whole in (False, True):
        params = OptimiseParams(preset="fast", whole_cells=whole)
        result = optimise(image, start, params, np.random.default_rng(2), contours=strength)
        faults.append(unlike_discs(lab[result.match[..., 0], result.match[..., 1], 0]))
    assert faults[0] >= 3
    assert faults[1] <= faults[0] // 3
