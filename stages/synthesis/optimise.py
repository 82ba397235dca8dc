"""Self-tuning texture optimisation: patch search and voting from coarse to fine."""

import dataclasses
from typing import Annotated, Any, Literal

import numpy as np
import pydantic
from jaxtyping import UInt32
from pydantic import Field as Knob

from stages.arrays import Channels, Correspondence, Field, Image
from stages.checkpoints import Checkpoints, NoCheckpoints
from stages.color import lab_from_linear
from stages.declare import InputError, Params, stage
from stages.progress import Progress, report
from stages.synthesis import _correspondence
from stages.synthesis._features import fixed_point, resize, scale_sizes, scaled
from stages.synthesis._search import Effort, Search
from stages.synthesis._vote import HistogramVote, mean_vote, vote_pixels, window

PRESETS: dict[str, dict[str, Any]] = {
    "kaspar2015": {},
    "default": {
        "occurrence_coarse": 30.0, "first_iterations": 14, "fewer_iterations": 2.0, "last_iterations": 4,
        "coarse_sweeps": 6, "fine_sweeps": 4, "random_share": 1.0, "enough": 0.002,
    },
    "fast": {
        "occurrence_coarse": 30.0, "first_iterations": 8, "fewer_iterations": 2.0, "last_iterations": 2,
        "coarse_sweeps": 3, "fine_sweeps": 2, "random_share": 1.0, "enough": 0.01, "ratio": 1.6,
    },
}  # fmt: skip


class OptimiseParams(Params):
    """What the optimisation can be told; every value that is not given comes from the preset."""

    preset: Literal["kaspar2015", "default", "fast"] = "default"
    patch_size: int = Knob(10, ge=3, le=32)
    tileable: bool = False
    occurrence: float = Knob(10.0, ge=0, le=1e4)
    occurrence_coarse: float = Knob(10.0, ge=0, le=1e4)
    overuse: float = Knob(2.0, ge=1)
    ratio: float = Knob(1.3, gt=1.0, le=4.0)
    coarsest: int = Knob(35, ge=8)
    first_iterations: int = Knob(30, ge=1, le=200)
    fewer_iterations: float = Knob(3.0, ge=0)
    last_iterations: int = Knob(5, ge=1, le=200)
    coarse_sweeps: int = Knob(10, ge=1, le=50)
    fine_sweeps: int = Knob(7, ge=1, le=50)
    random_tries: int = Knob(10, ge=0, le=100)
    fill_tries: int = Knob(6, ge=0, le=100)
    random_share: float = Knob(0.4, ge=0, le=1)
    histogram_share: float = Knob(0.5, ge=0, le=1)
    vote_sigma: float | None = None
    final_sigma: float | None = 1.3
    enough: float = Knob(0.0, ge=0, lt=1)

    @pydantic.model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, given: Any) -> Any:
        if isinstance(given, dict):
            return {**PRESETS.get(given.get("preset", "default"), {}), **given}
        return given


@dataclasses.dataclass(frozen=True)
class OptimiseScale:
    match: Annotated[UInt32[np.ndarray, "p q 2"], Channels(("row", "column"))]
    image: Image
    energy: float


@dataclasses.dataclass(frozen=True)
class Optimised:
    image: Image
    match: Correspondence
    energy: dict[str, Any]


@stage(version=1)
def optimise(
    image: Image,
    start: Correspondence,
    params: OptimiseParams,
    rng: np.random.Generator,
    guidance: Field | None = None,
    weight: float = 1.0,
    checkpoints: Checkpoints = NoCheckpoints(),
) -> Optimised:
    """[Kaspar2015]_."""
    size, wrap = params.patch_size, params.tileable
    planes = lab_from_linear(image.color)
    if guidance is not None:
        planes = np.concatenate([planes, guidance[..., None]], axis=2)
    channels = planes.shape[2]
    weights = np.array([1, 1, 1, weight][:channels], np.float32)
    margin = 0 if wrap else size - 1
    full = (start.shape[0] + 2 * margin, start.shape[1] + 2 * margin)
    factors = scale_sizes(image.height, image.width, params.coarsest, params.ratio)
    count = len(factors)
    keys = rng.spawn(count)
    match = None
    energies = []
    old = 1.0
    for level, factor in enumerate(factors, 1):
        height, width = scaled(image.height, factor), scaled(image.width, factor)
        small = resize(planes, height, width)
        if channels > 3:
            f = small[..., 3]
            small = small.copy()
            small[..., 3] = (f - f.min()) / max(float(np.ptp(f)), 1e-6) * 100
        exemplar = fixed_point(small * weights)
        places = (height - size + 1, width - size + 1)
        extra = 0 if wrap else size - 1
        patches = (scaled(full[0], factor) - extra, scaled(full[1], factor) - extra)
        if match is None:
            match = _correspondence.from_pixels(start, full, patches, places, size, factor)
        else:
            match = _correspondence.rescale(match, patches, places, factor / old)
        old = factor
        position = (level - 1) / max(1, count - 1)
        occurrence = params.occurrence_coarse * (max(params.occurrence,1e-9) / max(params.occurrence_coarse,1e-9)) ** position if params.occurrence else 0.0
        search = Search(exemplar, channels, size, places, patches, wrap, occurrence, params.overuse)
        stretched = (level - 1) * 9 / max(1, count - 1)
        iterations = max(params.last_iterations, round(params.first_iterations - params.fewer_iterations * stretched))
        early = level <= round(params.random_share * count)
        effort = Effort(
            sweeps=params.coarse_sweeps if level <= count / 2 else params.fine_sweeps,
            tries=params.random_tries if early else 0,
            fill_tries=params.fill_tries if level <= round(0.4 * count) and occurrence > 0 else 0,
            enough=params.enough,
        )
        histogram = None
        if level <= round(params.histogram_share * count):
            histogram = HistogramVote(
                exemplar, size, wrap, np.array([0, -80, -80, 0], np.float32)[:channels],
                np.array([100, 80, 80, 100 * weight], np.float32)[:channels],
            )  # fmt: skip
        target = mean_vote(match, exemplar, channels, window(size, params.vote_sigma), wrap)
        for iteration in range(1, iterations + 1):
            energy, share = search.step(target, match, effort, keys[level - 1])
            if histogram is not None and iteration < iterations:
                target = histogram(match, target, keys[level - 1])
            else:
                target = mean_vote(match, exemplar, channels, window(size, params.vote_sigma), wrap)
            report(Progress(0, level, count, iteration, iterations, energy))
            if share <= params.enough:
                break
        energies.append(energy)
    pixels = vote_pixels(match, image.pixels, window(size, params.final_sigma), wrap)
    pixel_match = _correspondence.to_pixels(match, size, wrap)
    inner = (slice(margin, margin + start.shape[0]), slice(margin, margin + start.shape[1]))
    return Optimised(
        Image(np.ascontiguousarray(pixels[inner]), image.channels),
        np.ascontiguousarray(pixel_match[inner]),
        {"scales": energies},
    )
