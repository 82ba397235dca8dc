"""What the page begins with, and why a request is refused."""

from __future__ import annotations

from typing import Annotated, Literal

from texloom.pipelines.studio.messages.message import Message
from texloom.pipelines.studio.messages.recipes import MOST_PICTURES, Lists, Params
from texloom.stages.vocabulary.sizes import SIDES


class Picture(Message):
    """A picture or a folder of material maps that a flow can start from."""

    id: str
    """``folder:PATH``, ``dropped:PATH``, ``run:PATH``, ``shipped:PATH``, ``texloom:NAME`` or ``skimage:NAME``"""
    name: str
    height: int
    width: int
    is_material: bool
    """whether it is a set of maps"""
    is_photograph: bool = False
    """whether a camera has taken it, so that it may show more than a surface from the front"""


class PicturePage(Message):
    """Some of the pictures that there are, and what is not shown."""

    pictures: tuple[Picture, ...]
    asked: int
    """how many were looked at for these; others of them cannot be read"""
    found: int
    """that the search finds"""
    total: int
    folders: dict[str, int]
    """that hold pictures, ``:dropped`` for those that were dropped, and how many"""
    notes: tuple[str, ...]
    """what is not shown, a line each"""


class OtherPicture(Message):
    """A picture that a flow takes besides the exemplar."""

    source: str
    about: str
    is_required: bool
    painted: tuple[str, str] | None = None
    """what black and white mean, where it is a map that can be painted"""


class SeveralPictures(Message):
    """The pictures of which a flow takes several."""

    source: str
    least: int
    most: int = MOST_PICTURES
    is_ordered: bool = True
    """whether their order matters"""
    ends: tuple[str, str]
    """what the first and the last one are; empty: nothing else than the others"""
    weights: str = ""
    """the param that has a number for each of them, of how much of it there is to be; empty: none"""


Card = Literal["light", "region", "maps", "make"]
"""the step of making a material in which something is chosen"""


class Control(Message):
    """A param that the page offers as a slider or a switch."""

    param: str
    label: str
    least: float
    most: float
    default: float
    ends: tuple[str, str]
    """what the least and the most mean"""
    is_switch: bool = False
    card: Card = "make"


class Setting(Message):
    """Values of params, under a name."""

    name: str
    params: Params
    lists: Lists
    udim: str = ""
    """as of a recipe"""


class Picker(Message):
    """Settings of which one is taken; the first has the flow's own values."""

    label: str
    settings: tuple[Setting, ...]
    without: str = ""
    """a source beside which it does nothing; empty: none"""
    card: Card = "make"


class ResultPicture(Message):
    """An export that the page shows."""

    file: str
    name: str


class Method(Message):
    """A flow that makes a texture of one exemplar, or of several."""

    flow: str
    about: str
    exemplar: str
    """the source that it begins with"""
    begins: Literal["picture", "maps", "photograph"]
    """what that is"""
    has_maps: bool
    """whether it makes all maps of a material"""
    size: Annotated[tuple[int, int], SIDES] | None
    """the default one, ``WIDTHxHEIGHT``, px; none where that of the exemplars decides"""
    can_tile: bool
    tiles: bool
    """whether it does where nothing else is said"""
    presets: tuple[str, ...]
    uniformity: str
    """the param of spatial uniformity, as ``texture.occurrence``; empty where there is none"""
    default_uniformity: float
    others: tuple[OtherPicture, ...]
    several: SeveralPictures | None
    """in place of the exemplar"""
    choices: tuple[Picker, ...]
    controls: tuple[Control, ...]
    views: tuple[ResultPicture, ...]
    """what is shown of a result, the preview first; none: the texture"""
    is_texture: bool
    """whether it makes one texture, as large as the recipe says"""
    can_correct: bool
    """whether spots of it can be corrected"""


class Start(Message):
    """What the page begins with."""

    folder: str
    store: str
    version: str
    listed: PicturePage
    """the first pictures of the folder"""
    examples: tuple[Picture, ...]
    meshes: tuple[str, ...]
    """ids: ``folder:PATH``, ``dropped:PATH`` or ``texloom:NAME``"""
    mesh_suffixes: tuple[str, ...]
    """of files that are meshes, with the dot"""
    methods: tuple[Method, ...]
    layouts: tuple[str, ...]
    """programs that material sets can be written for"""


class Problem(Message):
    """Why a request is refused; one line."""

    problem: str
