"""What can be done with materials."""

from __future__ import annotations

import pytest

from texloom.pipelines.studio.jobs import Jobs
from texloom.pipelines.studio.messages.drawings import Drawing, DrawnCollage
from texloom.pipelines.studio.messages.projects import MaterialRequest, ProjectView
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.projects.project import Project, stem
from texloom.pipelines.studio.projects.wall import wall
from texloom.stages.vocabulary.declare import InputError


def recipe(flow: str = "quilting", picture: str = "folder:moss.png", seed: int = 7) -> Recipe:
    return Recipe(flow=flow, sources={"exemplar": picture}, seed=seed)


def project() -> tuple[Project, list[str]]:
    """An empty project, and what it wants to be saved."""
    saved: list[str] = []
    return Project(ProjectView(), [], saved.append), saved


def test_names_are_never_equal_as_names_of_files() -> None:
    one, _ = project()
    names = [
        one.create(name, None).name for name in ("Old wall", "old_wall", "Old wall", "Old wall 3", "レンガ", "!?")
    ]
    assert len({stem(name).casefold() for name in names}) == len(names)
    assert names[:3] == ["Old wall", "old_wall 2", "Old wall 3"]
    first, second = list(one.materials)[:2]
    for taken in ("OLD WALL", "old-wall".replace("-", "_"), "Old  wall"):
        with pytest.raises(InputError, match="files are called so already"):
            one.edit(second, MaterialRequest(name=taken))
    one.edit(first, MaterialRequest(is_deleted=True))
    with pytest.raises(InputError, match="in the bin"):
        one.edit(second, MaterialRequest(name="Old wall"))
    assert one.edit(second, MaterialRequest(name="Old wall 9")).is_named


def test_a_material_follows_its_picture_until_it_is_named() -> None:
    one, saved = project()
    made = one.create("moss", recipe())
    assert one.edit(made.id, MaterialRequest(draft=recipe(picture="folder:bark.png")), "bark").name == "bark"
    one.edit(made.id, MaterialRequest(name="Trunk"))
    assert one.edit(made.id, MaterialRequest(draft=recipe()), "moss").name == "Trunk"
    count = len(saved)
    one.edit(made.id, MaterialRequest(draft=recipe()))
    assert len(saved) == count  # nothing has changed


def test_a_result_that_is_corrected_keeps_its_name() -> None:
    one, _ = project()
    made = one.create("Old wall", recipe())
    first, second, third = (Jobs.new("", recipe(flow)) for flow in ("quilting", "revise", "revise"))
    one.add(made.id, first)
    one.add(made.id, second, first.id)
    one.add(made.id, third, second.id)
    assert {one.export_name(job.id) for job in (first, second, third)} == {"Old_wall_quilting"}
    assert one.material(made.id).shown == third.id
    other = one.create("Old wall", recipe())
    job = Jobs.new("", recipe())
    one.add(other.id, job)
    assert one.export_name(job.id) == "Old_wall_2_quilting"


def test_a_folder_with_files_of_a_material_stays_its_own() -> None:
    one, _ = project()
    first, second = one.create("a", recipe()), one.create("b", recipe())
    jobs = [Jobs.new("", recipe()) for _ in range(2)]
    one.add(first.id, jobs[0])
    one.add(second.id, jobs[1])
    one.saved_in(jobs[0].id, "a_quilting")
    one.edit(first.id, MaterialRequest(name="c"))
    one.edit(second.id, MaterialRequest(name="a"))
    with pytest.raises(InputError, match=r"^a_quilting: holds the files of c; rename this material$"):
        one.check_folder(jobs[1].id, one.export_name(jobs[1].id))
    one.check_folder(jobs[0].id, "a_quilting")


def test_what_a_server_has_not_finished_the_next_one_goes_on_with_but_not_for_ever() -> None:
    one, _ = project()
    made = one.create("moss", recipe())
    done, running, waiting = (Jobs.new("", recipe(seed=seed)) for seed in range(3))
    for job in (done, running, waiting):
        one.add(made.id, job)
    one.update(done.model_copy(update={"state": "done"}), "quilting-1")
    one.update(running.model_copy(update={"state": "running"}))
    for _ in range(2):
        next_one = Project(one.view, one.materials.values(), lambda _: None)
        next_one.pause()
        assert [job.id for job in next_one.interrupted()] == [running.id, waiting.id]  # as often as it is ended
    one.update(running.model_copy(update={"state": "running"}))
    assert [job.id for job in one.interrupted()] == [running.id, waiting.id]
    one.update(running.model_copy(update={"state": "running"}))
    assert [job.id for job in one.interrupted()] == [waiting.id]
    found = one.variant(running.id)
    assert found is not None
    assert found.job.state == "failed"
    assert found.job.text


def test_results_made_elsewhere_find_their_material() -> None:
    one, _ = project()
    made = one.create("moss", recipe())
    assert one.matching(recipe(seed=9)) == made
    assert one.matching(recipe(flow="self_tuning")) is None
    one.edit(made.id, MaterialRequest(is_deleted=True))
    assert one.matching(recipe()) is None


def test_the_wall_finds_sorts_and_counts() -> None:
    one, _ = project()
    for number in range(150):
        made = one.create(f"stone {number}", recipe())
        if number % 10 == 0:
            one.edit(made.id, MaterialRequest(tags=("wet", "old"), is_favourite=number % 20 == 0))
        if number % 50 == 49:
            one.edit(made.id, MaterialRequest(is_deleted=True))
    shown = wall(one, ["problem"], sorting="name", count=40)
    assert (len(shown.shown), shown.found, shown.kept, shown.deleted) == (40, 147, 147, 3)
    assert shown.tags == {"old": 15, "wet": 15}
    assert shown.problems == ("problem",)
    assert wall(one, [], sorting="name", first=40, count=40).shown[0].name > shown.shown[-1].name
    assert wall(one, [], tag="wet").found == 15
    assert wall(one, [], favourites=True).found == 8
    assert wall(one, [], search="WET stone quilt").found == 15
    assert wall(one, [], search="149").found == 0
    assert [entry.name for entry in wall(one, [], search="149", deleted=True).shown] == ["stone 149"]
    assert len(wall(one, [], count=10**6).shown) == 120
    newest = wall(one, [], count=1).shown[0]
    assert newest.name == "stone 149" if newest.is_deleted else newest.name == "stone 148"


def test_a_copy_has_the_settings_and_a_name_of_its_own() -> None:
    one, _ = project()
    drawing = Drawing(picture="folder:moss.png", collage=DrawnCollage(pieces=(), strength=40))
    made = one.edit(one.create("moss", recipe(seed=9)).id, MaterialRequest(tags=("wet",), drawing=drawing))
    one.add(made.id, Jobs.new("", recipe(seed=9)))
    copy = one.duplicate(made.id)
    assert (copy.name, copy.draft, copy.tags, copy.variants) == ("moss 2", recipe(seed=9), ("wet",), ())
    assert copy.drawing == drawing
