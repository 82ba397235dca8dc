"""A texture under a control map, from an exemplar whose own control map is known."""

import dataclasses
import itertools
import logging
import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

import numpy as np
import pydantic
from jaxtyping import Float32, UInt32
from pydantic import Field as Knob

from stages.arrays import Channels, Correspondence, Image
from stages.checkpoints import Checkpoints, NoCheckpoints
from stages.declare import InputError, Params, stage
from stages.progress import Progress, report
from stages.synthesis import _correspondence
from stages.synthesis._control import (
    CONTROL_WEIGHT,
    ControlScale,
    check_aspect,
    check_channels,
    check_control,
    check_finite,
    fit_scale,
    match_channels,
)
from stages.synthesis._correlation import correlation
from stages.synthesis._correspondence import Patches
from stages.synthesis._discrete import LARGEST, Movement, Neighbourhoods, TurnedMovement
from stages.synthesis._features import fixed_point, resize, scale_sizes, scaled
from stages.synthesis._frames import Frames, Places, begun, between, within
from stages.synthesis._search import Effort, Search
from stages.synthesis._vote import copy_vote, mean_vote, vote_pixels, window
from stages.synthesis.initialise import Size

_LOG = logging.getLogger(__name__)

_UNRELATED = 0.05  # share of the texture explained below which control is said to tell nothing
_LONGEST_RUN = 368  # values in a row of a patch up to which distances are exact
_DISCRETE_RATIO = 1.8  # of scales whose pixels move one by one
_REACH = 1  # px to every side by which the last vote tells proposals apart
_SIGMA = 1.0  # px; how far from a patch's middle its votes count in a last vote that is a mean
_PLACES = 32  # places tried for each block of the start

PRESETS: dict[str, dict[str, Any]] = {
    "default": {"ratio": 1.5, "first_iterations": 12, "last_iterations": 3, "sweeps": 4, "enough": 0.005},
    "fast": {"ratio": 2.0, "first_iterations": 8, "last_iterations": 2, "sweeps": 2, "enough": 0.02},
}


class ReconstructParams(Params):
    """How the texture is made. A preset fills in every value that is not given."""

    preset: Literal["default", "fast"] = "default"
    """`default`: as good as it gets; `fast`: fewer scales and rounds"""
    solver: Literal["optimise", "discrete"] = "optimise"
    """`optimise`: patch search and voting in turn; `discrete`: pixels move one by one to what continues their
    neighbours, quick but less whole; only this one follows ``target_jacobian``"""
    size: Size | None = None
    """height and width of the result, px; null takes those of the target or of its Jacobians"""
    control_weight: float = Knob(CONTROL_WEIGHT, gt=0, le=100)
    """how much control counts: its variance, all channels together, by that of the texture. 1 lets both count
    alike, 0.25 leads gently, 10 forces; the same scale as in `control_features`"""
    patch_size: int = Knob(8, ge=3, le=32)
    """side of a patch, px; of the discrete solver, of the pieces that it begins with"""
    tileable: bool = False
    """the result continues across its borders; so should the target"""
    occurrence: float = Knob(20.0, ge=0, le=1e4)
    """what an exemplar patch of average use costs, CIELAB units squared a pixel; 0 lets smooth patches repeat, far
    more keeps control from asking for some places more often than for others"""
    ratio: float = Knob(1.5, gt=1.0, le=4.0)
    """size of a scale relative to the one before it, at least"""
    coarsest: int = Knob(32, ge=8)
    """exemplar's shorter side at the first scale, px; never below one and a half patches"""
    first_iterations: int = Knob(12, ge=1, le=200)
    """rounds of search and vote at the first scale"""
    last_iterations: int = Knob(3, ge=1, le=200)
    """rounds at the last scale"""
    sweeps: int = Knob(4, ge=1, le=50)
    """scans of patch search a round"""
    random_tries: int = Knob(6, ge=0, le=100)
    """random places tried for a patch in the first scan of a round; one fewer in each that follows"""
    enough: float = Knob(0.005, ge=0, lt=1)
    """a scale ends early when a round changes no more than this share of the patches"""
    last_vote: Literal["copy", "mean"] = "copy"
    """`copy`: each pixel is one of the exemplar pixels that the patches over it propose, sharp; `mean`: it is their
    average, smoother and softer"""

    @property
    def matched(self) -> int:
        """Side of what has one match, px."""
        return self.patch_size if self.solver == "optimise" else 1

    @pydantic.model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, given: Any) -> Any:
        if isinstance(given, dict) and isinstance(given.get("preset", "default"), str):
            return {**PRESETS.get(given.get("preset", "default"), {}), **given}
        return given


@dataclasses.dataclass(frozen=True)
class ReconstructScale:
    """The state after a scale, from which the next one goes on."""

    match: Annotated[UInt32[np.ndarray, "p q 2"], Channels(("row", "column"))]
    """top-left pixel of the exemplar patch of each patch of the result, at this scale"""
    image: Image
    """the result so far"""
    places: Annotated[Float32[np.ndarray, "p q 2"], Channels(("row", "column"))] | None
    """what ``match`` rounds, where the texture turns"""
    scales: list[dict[str, Any]]
    """the scales so far; see `Reconstructed`"""


@dataclasses.dataclass(frozen=True)
class Reconstructed:
    """The texture."""

    image: Image
    """all channels of the exemplar, copied; where the texture turns, interpolated between pixels"""
    match: Correspondence
    """the exemplar pixel under each pixel of the result, or the nearest to it"""
    tileable: bool
    """whether it wraps around"""
    correlation: float
    """share of the exemplar's variance that its control explains beyond chance, 0..1; 0 without control"""
    notes: list[str]
    """what a person should know of the inputs; a sentence each"""
    scales: list[dict[str, Any]]
    """for each scale, coarsest first: the result's height and width, px; the rounds made; the energy a patch,
    CIELAB units squared a pixel in all planes, of it the price for occurrence; the share of patches changed in the
    last round. Of the discrete solver, the energy is that of the pixels that still chose in the last round"""


def check_sizes(params: ReconstructParams, known: Mapping[str, Any]) -> None:
    """Texture, control and target must fit each other and hold more than one patch."""
    image, control, target = (known.get(name) for name in ("image", "control", "target"))
    if image is not None and min(image.height, image.width) <= params.patch_size:
        raise InputError(
            f"image: {image.height}x{image.width} px is too small for patches of {params.patch_size} px; "
            "lower patch_size or give a larger exemplar"
        )
    if image is not None and control is not None:
        check_aspect(control, "control", (image.height, image.width), "image")
    if target is not None and control is not None:
        check_channels(target, control)
    if target is not None:
        size = params.size or (target.height, target.width)
        check_aspect(target, "target", size, "size")
        if min(size) <= params.patch_size:
            raise InputError(
                f"target: a result of {size[0]}x{size[1]} px does not hold more than one patch of "
                f"{params.patch_size} px"
            )


@dataclasses.dataclass(frozen=True)
class _Scale:
    """What is done at one scale."""

    level: int  # from 1, the coarsest
    factor: float
    exemplar: tuple[int, int]
    places: tuple[int, int]  # exemplar patches down and across
    target: tuple[int, int]
    patches: tuple[int, int]  # target patches down and across
    iterations: int

    @property
    def cost(self) -> float:
        return float(self.iterations * self.patches[0] * self.patches[1])


def _plan(exemplar: tuple[int, int], result: tuple[int, int], params: ReconstructParams) -> list[_Scale]:
    """The scales, coarsest first."""
    size, wrap = params.matched, params.tileable
    least = 2 * size if wrap else size + 1  # px that hold patches at every scale
    coarsest = max(params.coarsest, math.ceil(1.5 * size), math.ceil(least * min(exemplar) / min(result)))
    ratio = params.ratio if params.solver == "optimise" else max(params.ratio, _DISCRETE_RATIO)
    factors = scale_sizes(*exemplar, coarsest, ratio)
    extra = size - 1
    scales: list[_Scale] = []
    for level, factor in enumerate(factors, 1):
        way = (level - 1) / (len(factors) - 1) if len(factors) > 1 else 1.0
        sides = [scaled(side, factor) for side in exemplar]
        target = [scaled(side, factor) for side in result]
        across = [side - (0 if wrap else extra) for side in target]
        scales.append(
            _Scale(
                level=level,
                factor=factor,
                exemplar=(sides[0], sides[1]),
                places=(sides[0] - extra, sides[1] - extra),
                target=(target[0], target[1]),
                patches=(across[0], across[1]),
                iterations=round(
                    params.first_iterations * (params.last_iterations / params.first_iterations) ** way
                ),
            )
        )
    return scales


class _Reconstruction:
    """The data of one run that are the same at every scale, and what is done at a scale."""

    def __init__(
        self,
        image: Image,
        control: Image | None,
        target: Image | None,
        scale: ControlScale,
        scales: list[_Scale],
        params: ReconstructParams,
        jacobian: np.ndarray | None,
    ):
        self.image = image
        self.jacobian = jacobian
        full = scales[-1]
        self.texture = scale.of_texture(image)
        self.control = _planes(scale, control, full.exemplar)
        self.target = _planes(scale, target, full.target)
        self.channels = self.texture.shape[2] + self.control.shape[2]
        self.scales = scales
        self.params = params
        self.known: dict[int, Neighbourhoods] = {}
        self.even = window(params.patch_size)

    def exemplar(self, scale: _Scale) -> np.ndarray:
        """Fixed-point features of texture and control."""
        planes = np.concatenate([self.texture, self.control], axis=2)
        return np.asarray(fixed_point(resize(planes, *scale.exemplar)))

    def given(self, scale: _Scale) -> np.ndarray:
        """Fixed-point features of the target, (H, W, k); a torus is padded by a patch less one."""
        planes = resize(self.target, *scale.target)
        if self.params.tileable:
            extra = self.params.patch_size - 1
            planes = np.pad(planes, ((0, extra), (0, extra), (0, 0)), mode="wrap")
        return np.asarray(fixed_point(planes).reshape(*planes.shape))

    def frames(self, scale: _Scale) -> Frames | None:
        """How the texture turns, if it does."""
        return None if self.jacobian is None else Frames.of(self.jacobian, *scale.target)

    def given_start(self, start: Correspondence, scale: _Scale, size: tuple[int, int]) -> Patches | Places:
        """A correspondence of full size at a scale."""
        if self.jacobian is not None:
            return begun(start, scale.factor, scale.patches, scale.places)
        return _correspondence.from_pixels(
            start, size, scale.patches, scale.places, self.params.matched, scale.factor
        )

    def finer(self, match: Patches | Places, scale: _Scale) -> np.ndarray:
        """What the scale before ended with, at this scale."""
        growth = scale.factor / self.scales[scale.level - 2].factor
        frames = self.frames(scale)
        if frames is not None:
            return np.asarray(frames.finer(match, growth, scale.places))
        return np.asarray(_correspondence.rescale(match, scale.patches, scale.places, growth))

    def start(self, scale: _Scale, random: np.random.Generator) -> Patches | Places:
        """Blocks of the exemplar, each the one whose control suits best among some random ones."""
        own = resize(self.control, *scale.exemplar)
        wanted = resize(self.target, *scale.target)
        side = min(self.params.patch_size, *scale.exemplar)
        frames = self.frames(scale)
        match = np.empty((2, *scale.patches), np.int32 if frames is None else np.float32)
        for top in range(0, scale.patches[0], side):
            for left in range(0, scale.patches[1], side):
                block = wanted[top : top + side, left : left + side]
                rows = random.integers(0, scale.exemplar[0] - side + 1, _PLACES)
                columns = random.integers(0, scale.exemplar[1] - side + 1, _PLACES)
                errors = [
                    float(((own[r : r + block.shape[0], c : c + block.shape[1]] - block) ** 2).sum())
                    for r, c in zip(rows, columns, strict=True)
                ]
                best = int(np.argmin(errors))
                into = (slice(top, top + side), slice(left, left + side))
                offset = np.indices(match[0][into].shape)
                if frames is not None:
                    offset = frames.carried(offset - side // 2, into) + side // 2
                corner = np.array([rows[best], columns[best]])[:, None, None]
                match[:, *into] = within(corner + offset, scale.places)
        return match

    def improve(self, match: Patches | Places, scale: _Scale, random: np.random.Generator) -> dict[str, Any]:
        """Improve ``match`` in place at one scale; what `Reconstructed.scales` says of it."""
        solver = self.discrete if self.params.solver == "discrete" else self.patches
        rounds = solver(match, scale, random)
        before = sum(other.cost for other in self.scales[: scale.level - 1])
        total = sum(other.cost for other in self.scales)
        energy, price, changed, iteration, ended = 0.0, 0.0, 1.0, 0, False
        while not ended:
            iteration += 1
            energy, price, changed = next(rounds)
            ended = iteration == scale.iterations or changed <= self.params.enough
            report(
                Progress(
                    done=(before + scale.cost * (1 if ended else iteration / scale.iterations)) / total,
                    scale=scale.level,
                    scales=len(self.scales),
                    iteration=iteration,
                    iterations=scale.iterations,
                    energy=energy,
                    preview=lambda: self.picture(match, scale)[0],
                )
            )
        height, width = scale.target
        return {
            "height": height, "width": width, "rounds": iteration,
            "energy": energy, "price": price, "changed": changed,
        }  # fmt: skip

    def patches(
        self, match: Patches, scale: _Scale, random: np.random.Generator
    ) -> Iterator[tuple[float, float, float]]:
        """Rounds of patch search and vote; energy, price and changed share after each."""
        params = self.params
        exemplar, given = self.exemplar(scale), self.given(scale)
        search = Search(
            exemplar, self.channels, params.patch_size, scale.places, scale.patches, params.tileable,
            params.occurrence, overuse=2.0,
        )  # fmt: skip
        effort = Effort(params.sweeps, params.random_tries, 0, params.enough)
        while True:
            yield search.step(self.vote(match, exemplar, given), match, effort, random)

    def discrete(
        self, match: Patches | Places, scale: _Scale, random: np.random.Generator
    ) -> Iterator[tuple[float, float, float]]:
        """Rounds in which pixels move; energy, price and changed share after each."""
        params = self.params
        given = resize(self.target, *scale.target)
        shared = (self.neighbourhoods(scale), given, params.occurrence, params.tileable)
        frames = self.frames(scale)
        movement = Movement(*shared) if frames is None else TurnedMovement(*shared, frames)
        last = scale.level == len(self.scales)
        source = np.ascontiguousarray(np.moveaxis(match, 0, 2))
        for number in itertools.count():
            found = movement(source, 0 if last else params.random_tries, last or number % 2 == 1, random)
            match[:] = np.moveaxis(source, 2, 0)
            yield found

    def neighbourhoods(self, scale: _Scale) -> Neighbourhoods:
        """The exemplar as the discrete solver sees it; kept for the scale that follows."""
        if scale.level not in self.known:
            coarser = None
            if scale.level > 1 and scale.exemplar[0] * scale.exemplar[1] > LARGEST:
                coarser = self.neighbourhoods(self.scales[scale.level - 2])
            texture, control = (resize(planes, *scale.exemplar) for planes in (self.texture, self.control))
            self.known = {scale.level: Neighbourhoods.of(texture, control, coarser)}
        return self.known[scale.level]

    def vote(self, match: Patches, exemplar: np.ndarray, given: np.ndarray) -> np.ndarray:
        """The mean of what patches propose, under the control that is given."""
        target: np.ndarray = mean_vote(match, exemplar, self.channels, self.even, self.params.tileable)
        target.reshape(given.shape[0], -1, self.channels)[..., self.texture.shape[2] :] = given
        return target

    def picture(self, match: Patches | Places, scale: _Scale) -> tuple[Image, Correspondence]:
        """The result at a scale, all channels, linear; and where its pixels come from."""
        size, wrap = self.params.patch_size, self.params.tileable
        small = resize(self.image.pixels, *scale.exemplar)
        if self.jacobian is not None:
            return between(Image(small, self.image.channels), match), _pixels(match)
        if self.params.solver == "discrete":
            return Image(small[match[0], match[1]], self.image.channels), _correspondence.to_pixels(match, 1, wrap)
        if self.params.last_vote == "mean":
            pixels = vote_pixels(match, small, window(size, _SIGMA), wrap)
            return Image(pixels, self.image.channels), _correspondence.to_pixels(match, size, wrap)
        exemplar = self.exemplar(scale)
        target = self.vote(match, exemplar, self.given(scale))
        source = copy_vote(match, target, exemplar, self.channels, size, _REACH, wrap)
        return Image(small[source[..., 0], source[..., 1]], self.image.channels), source.astype(np.uint32)


def _pixels(places: Patches | Places) -> Correspondence:
    """The nearest pixels, one a row and column."""
    return np.ascontiguousarray(np.moveaxis(np.rint(places), 0, 2).astype(np.uint32))


def _planes(scale: ControlScale, control: Image | None, size: tuple[int, int]) -> np.ndarray:
    """Control at ``size``; no planes where there is none."""
    return np.zeros((*size, 0), np.float32) if control is None else scale.of_control(control, *size)


@stage(version=2, check=check_sizes)
def reconstruct(
    image: Image,
    params: ReconstructParams,
    rng: np.random.Generator,
    control: Image | None = None,
    target: Image | None = None,
    start: Correspondence | None = None,
    target_jacobian: Float32[np.ndarray, "rows columns 4"] | None = None,
    checkpoints: Checkpoints = NoCheckpoints(),  # noqa: B008
) -> Reconstructed:
    """Make a texture that looks like the exemplar wherever the target's control is like the exemplar's.

    With the control map of the texture that a compaction was made from as target, this reconstructs that texture;
    with any other map it makes a new one. The exemplar may be a compaction or a whole texture.

    As in texture optimisation, patch search and voting alternate from coarse to fine; patches are compared by
    texture and control together, and the control of the result is the target's at all times. In the end every
    pixel becomes that exemplar pixel, of those that the patches over it propose, whose surroundings are most like
    the mean vote; so it is a copy of all channels, and as sharp as the exemplar.

    Parameters
    ----------
    image : the exemplar; all its channels are compared, colour in CIELAB.
    control : its control map, of any number of channels; a map of another size is resampled. None for a texture
        that is the same all over: then no target is given, but ``params.size`` or ``target_jacobian``.
    target : the control map of the result, with the same channels; values beyond those of ``control`` count as its
        least or greatest.
    start : exemplar pixel of every pixel of the result, to begin with; none begins with blocks whose control fits.
    target_jacobian : how the texture is to turn in the result, as in `per_pixel`; see `compact_oriented`.
        Neighbourhoods of the result are read along it, and so is what continues a pixel's neighbours. For the
        discrete solver.

    Raises
    ------
    InputError
        the maps do not fit the exemplar or each other, a value is not finite, a patch does not fit, or
        ``target_jacobian`` is given to the other solver or has a pixel without area.
    ValueError
        ``start`` does not fit the exemplar or the result.

    References
    ----------
    [Wei2008]_ section 5, and equation 1 for neighbourhoods read along directions; [Kwatra2005]_ for the
    optimisation; [Barnes2009]_ for the search.
    """
    check_sizes(params, {"image": image, "control": control, "target": target})
    check_finite(image, "image")
    if control is not None and target is not None:
        check_control(control, "control")
        check_finite(target, "target")
        target = match_channels(target, control)
    elif control is not None or target is not None:
        raise InputError("reconstruct: control and target go together; give both or neither")
    if target_jacobian is not None and params.solver != "discrete":
        raise InputError(f"target_jacobian: only the discrete solver follows it; solver is {params.solver}")
    shape = (image.height, image.width)
    size = _size(params, target, target_jacobian)
    if start is not None and (start.shape[:2] != size or (start.max(axis=(0, 1)) >= shape).any()):
        raise ValueError(f"start of shape {start.shape[:2]} for a result of {size} from an exemplar of {shape}")
    scale = fit_scale(image, control, params.control_weight)
    if scale.planes * params.patch_size > _LONGEST_RUN:
        raise InputError(
            f"image and control: {scale.planes} channels do not fit patches of {params.patch_size} px; "
            f"at most {_LONGEST_RUN // params.patch_size} do"
        )
    found, notes = 0.0, []
    if control is not None and target is not None:
        found = correlation(image, control, scale)
        notes = _notes(found, scale.beyond(target))
    for note in notes:
        _LOG.warning(note)

    scales = _plan(shape, size, params)
    work = _Reconstruction(image, control, target, scale, scales, params, target_jacobian)
    first_random, *randoms = rng.spawn(len(scales) + 1)
    match: Patches | Places | None = None
    done: list[dict[str, Any]] = []
    first = 0
    resumed = checkpoints.latest(ReconstructScale)
    if resumed is not None:
        first, state = resumed
        held = state.match.astype(np.int32) if state.places is None else state.places
        match, done = np.ascontiguousarray(np.moveaxis(held, 2, 0)), list(state.scales)
    for level, random in list(zip(scales, randoms, strict=True))[first:]:
        if match is not None:
            match = work.finer(match, level)
        elif start is not None:
            match = work.given_start(start, level, size)
        else:
            match = work.start(level, first_random)
        done.append(work.improve(match, level, random))
        if level.level < len(scales):
            places = None if target_jacobian is None else np.ascontiguousarray(np.moveaxis(match, 0, 2))
            checkpoints.save(
                level.level, ReconstructScale(_pixels(match), work.picture(match, level)[0], places, list(done))
            )
    assert match is not None
    picture, source = work.picture(match, scales[-1])
    return Reconstructed(
        image=picture,
        match=source,
        tileable=params.tileable,
        correlation=found,
        notes=notes,
        scales=done,
    )


def _size(params: ReconstructParams, target: Image | None, jacobian: np.ndarray | None) -> tuple[int, int]:
    """Height and width of the result."""
    if params.size is not None:
        return params.size
    if target is not None:
        return target.height, target.width
    if jacobian is None:
        raise InputError("reconstruct: without a target, size says how large the result is; it is not given")
    return jacobian.shape[0], jacobian.shape[1]


def _notes(correlation: float, beyond: float) -> list[str]:
    """Sentences on inputs that cannot give what they promise."""
    notes = []
    if correlation < _UNRELATED:
        notes.append(
            f"The control map explains {correlation:.1%} of the texture beyond chance: nothing can follow it."
        )
    if beyond > 0.01:
        notes.append(f"{beyond:.1%} of the target is beyond the control map's values and takes the nearest.")
    return notes
