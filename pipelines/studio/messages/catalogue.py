"""What the page begins with, and why a request is refused."""

from __future__ import annotations

from typing import Annotated

from texloom.pipelines.studio.messages.message import Message
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


class OtherPicture(Message):
    """A picture that a flow takes besides the exemplar."""

    source: str
    about: str
    is_required: bool


class Method(Message):
    """A flow that makes a texture of one exemplar."""

    flow: str
    about: str
    size: Annotated[tuple[int, int], SIDES]
    """the default one, ``WIDTHxHEIGHT``, px"""
    can_tile: bool
    presets: tuple[str, ...]
    uniformity: str
    """the param of spatial uniformity, as ``texture.occurrence``; empty where there is none"""
    default_uniformity: float
    others: tuple[OtherPicture, ...]


class Start(Message):
    """What the page begins with."""

    folder: str
    store: str
    version: str
    pictures: tuple[Picture, ...]
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
