"""Materials of a project, and the wall that shows them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from texloom.pipelines.studio.messages.catalogue import Picture
from texloom.pipelines.studio.messages.drawings import Drawing
from texloom.pipelines.studio.messages.message import Message
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.messages.runs import Job

SCHEMA = 3
"""of the files of a project; rises where an earlier texloom could not read them"""
MOST_VARIANTS = 1000
"""of one material"""
_Id = Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
_Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[^\x00-\x1f\x7f]*\w[^\x00-\x1f\x7f]*$")]
_Tag = Annotated[str, Field(min_length=1, max_length=32, pattern=r"^[^\x00-\x1f\x7f,]+$")]
_Tags = Annotated[tuple[_Tag, ...], Field(max_length=16)]
_View = Annotated[str, Field(pattern=r"^[a-z_]{0,32}$")]
_File = Annotated[str, Field(max_length=255)]


class Variant(Message):
    """A result of a material, at full size."""

    job: Job
    """the run that has made it, or makes it"""
    made: float = Field(ge=0)
    """when it was wanted, seconds since 1970"""
    parent: Annotated[str, Field(pattern=r"^([0-9a-f]{16})?$")] = ""
    """the variant that it corrects; empty: none"""
    folder: Annotated[str, Field(max_length=255, pattern=r"^([A-Za-z0-9_-][A-Za-z0-9_.-]*)?$")] = ""
    """of its exports, below ``runs`` in the store"""
    starts: int = Field(0, ge=0)
    """how many times a server ended while it ran"""


class Material(Message):
    """A material: a name, what is being tried, and what has been made; also the content of its file."""

    version: int = SCHEMA
    id: _Id
    name: _Name
    is_named: bool = False
    """whether a person chose the name; else it follows the picture"""
    tags: _Tags = ()
    is_favourite: bool = False
    is_deleted: bool = False
    made: float = Field(ge=0)
    """seconds since 1970"""
    changed: float = Field(ge=0)
    draft: Recipe | None = None
    """the settings as they are now"""
    shown: Annotated[str, Field(pattern=r"^([0-9a-f]{16})?$")] = ""
    """the variant that is looked at; empty: the preview"""
    mode: _View = ""
    """how it is looked at"""
    file: _File = ""
    """the export that is shown of a result"""
    drawing: Drawing = Drawing()
    saved_as: Annotated[tuple[_File, ...], Field(max_length=64)] = ()
    """the folders beside the pictures that hold its exports, which no other material may take"""
    variants: Annotated[tuple[Variant, ...], Field(max_length=MOST_VARIANTS)] = ()
    """in the order in which they were wanted"""


class OpenMaterial(Message):
    """A material with the pictures that its recipes begin with, as far as they can be read."""

    material: Material
    pictures: tuple[Picture, ...]
    missing: tuple[str, ...]
    """why others cannot be read"""


class MaterialRequest(Message):
    """A change of a material; what is not given stays."""

    name: _Name | None = None
    tags: _Tags | None = None
    is_favourite: bool | None = None
    is_deleted: bool | None = None
    draft: Recipe | None = None
    shown: Annotated[str, Field(pattern=r"^([0-9a-f]{16})?$")] | None = None
    mode: _View | None = None
    file: _File | None = None
    drawing: Drawing | None = None


class WallEntry(Message):
    """A material on the wall."""

    id: str
    name: str
    tags: tuple[str, ...]
    is_favourite: bool
    is_deleted: bool
    flow: str
    changed: float
    results: int
    is_running: bool
    cover: str
    """the variant whose picture is shown; empty: none is finished"""
    picture: str
    """id of the picture that it begins with, which is shown then; empty: none"""


Sorting = Literal["changed", "made", "name"]


class Wall(Message):
    """Some of the materials, and how many there are."""

    shown: tuple[WallEntry, ...]
    first: int
    """the number of those before them"""
    found: int
    """that the search finds"""
    kept: int
    """all but those in the bin"""
    deleted: int
    """in the bin"""
    tags: dict[str, int]
    """of those that are kept, and how many have each"""
    problems: tuple[str, ...]
    """files that cannot be read, and are left alone"""


class ProjectView(Message):
    """Where one was in a project."""

    view: _View = ""
    material: Annotated[str, Field(pattern=r"^([0-9a-f]{16})?$")] = ""


class ProjectViewRequest(ProjectView):
    """The same, from the page."""


class ProjectState(Message):
    """A project as the page begins with it."""

    name: str
    place: str
    """the folder of its files"""
    view: ProjectView
    materials: int
    problem: str = ""
    """why it cannot be saved; empty: it is"""


class MaterialChanged(Message):
    """A material is new or has changed, in this page or another."""

    kind: Literal["material_changed"] = "material_changed"
    id: str


class ProjectSaved(Message):
    """Whether all is saved."""

    kind: Literal["project_saved"] = "project_saved"
    problem: str
    """why not; empty: it is"""
