"""What counts of the code, and what does not."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import ROOT
from texloom.pipelines.engine import code_digest as code_digests
from texloom.pipelines.engine import user_cache
from texloom.pipelines.engine.code_digest import code_digest
from texloom.stages.lookup.registry import GROUPS, find_stage, stage_names

MODULE = '''
"""About it."""

import numpy as np

from texloom.stages.helpers import halved


class Settings:
    """How."""

    size: int = 3
    """a side"""


def work(value: int) -> int:
    """Work."""
    if value:
        return halved(value) + 1
    return 0
'''
HELPERS = "from texloom.stages.deeper import ONE\n\n\ndef halved(value):\n    return value // 2 * ONE\n"
DEEPER = "ONE = 1\n"


@pytest.fixture(autouse=True)
def table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where summaries of modules are kept meanwhile."""
    path = tmp_path / "cache" / "code.json"
    monkeypatch.setattr(user_cache, "_file", lambda name: path.with_name(f"{name}.json"))
    forget()
    yield path
    forget()


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package `stages` of its own, whose module `work` imports `helpers`, which imports `deeper`."""
    folder = tmp_path / "stages"
    folder.mkdir()
    for name, text in {"work": MODULE, "helpers": HELPERS, "deeper": DEEPER, "__init__": ""}.items():
        (folder / f"{name}.py").write_text(text)
    (folder / "other.py").write_text("import texloom.stages.work\n")
    (folder / "group").mkdir()
    (folder / "group" / "__init__.py").write_text("")
    (folder / "group" / "inner.py").write_text("TWO = 2\n")
    monkeypatch.setattr(code_digests, "_ROOT", tmp_path)
    return folder


def forget() -> None:
    """As in a new process."""
    for cached in (
        code_digest,
        code_digests._path,
        code_digests._data_files,
        code_digests._summary,
        code_digests._known,
        code_digests._parser,
    ):
        cached.cache_clear()


def digest_after(path: Path, old: str, new: str) -> bool:
    """Whether the digest of `work` changes with a text in ``path``."""
    before = code_digest("texloom.stages.work")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    forget()
    return code_digest("texloom.stages.work") != before


COUNTS = {
    "a statement": ("work", "return 0", "return 1"),
    "an operator": ("work", "+ 1", "- 1"),
    "a name": ("work", "value: int) -> int", "number: int) -> int"),
    "a default": ("work", "size: int = 3", "size: int = 4"),
    "a statement more": ("work", "    return 0", "    print()\n    return 0"),
    "a decorator": ("work", "def work", "@staticmethod\ndef work"),
    "a text that is a value": ("work", "return 0", 'return "words"'),
    "an imported module": ("helpers", "// 2", "// 3"),
    "a module that an imported one imports": ("deeper", "ONE = 1", "ONE = 2"),
    "an import": ("work", "import numpy as np", "import numpy as np\nimport texloom.stages.group.inner"),
}
COUNTS_NOT = {
    "a comment": ("work", "return 0", "return 0  # nothing"),
    "a comment line": ("work", "import numpy", "# numbers\nimport numpy"),
    "the module's docstring": ("work", "About it.", "About this."),
    "a docstring less": ("work", '"""About it."""', ""),
    "a class's docstring": ("work", "How.", "How it is done."),
    "a field's docstring": ("work", "a side", "a side, px"),
    "a function's docstring": ("work", "Work.", "Work on a value.\n\n    More."),
    "blank lines": ("work", "    return 0", "\n\n    return 0\n\n"),
    "brackets": ("work", "return 0", "return (0)"),
    "a broken line": ("work", "halved(value) + 1", "(\n            halved(value)\n            + 1\n        )"),
    "other quotes": ("work", '"""Work."""', "'''Work.'''"),
    "a comment in an imported module": ("helpers", "* ONE", "* ONE  # once"),
    "a module that imports it": ("other", "import texloom.stages.work", "import texloom.stages.work as it"),
    "a module that is not imported": ("group/inner", "TWO = 2", "TWO = 3"),
}


@pytest.mark.parametrize(("module", "old", "new"), COUNTS.values(), ids=COUNTS)
def test_code_that_counts(tree: Path, module: str, old: str, new: str) -> None:
    assert digest_after(tree / f"{module}.py", old, new)


@pytest.mark.parametrize(("module", "old", "new"), COUNTS_NOT.values(), ids=COUNTS_NOT)
def test_code_that_does_not_count(tree: Path, module: str, old: str, new: str) -> None:
    assert not digest_after(tree / f"{module}.py", old, new)


IMPORTS = {
    "whole": "import texloom.stages.group.inner",
    "renamed": "import texloom.stages.group.inner as short",
    "from its package": "from texloom.stages.group import inner",
    "a name of it": "from texloom.stages.group.inner import TWO",
    "relative": "from .group import inner",
    "relative name": "from .group.inner import TWO",
    "package alone, relative": "from . import group\nfrom .group import inner",
    "in a function": "def f():\n    from texloom.stages.group import inner",
    "in a class": "class C:\n    import texloom.stages.group.inner",
    "in a condition": "if True:\n    pass\nelse:\n    import texloom.stages.group.inner",
    "in a loop": "for _ in range(2):\n    pass\nelse:\n    import texloom.stages.group.inner",
    "in a while": "while True:\n    import texloom.stages.group.inner",
    "in a with": "with open('x'):\n    import texloom.stages.group.inner",
    "in a try": "try:\n    import nothing\nexcept ImportError:\n    import texloom.stages.group.inner",
    "in a finally": "try:\n    pass\nfinally:\n    import texloom.stages.group.inner",
    "in a try of groups": "try:\n    pass\nexcept* ValueError:\n    import texloom.stages.group.inner",
    "in a match": "match 1:\n    case 1:\n        import texloom.stages.group.inner",
    "in a coroutine": "async def f():\n    async with g():\n        import texloom.stages.group.inner",
    "for types alone": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import texloom.stages.group.inner",
}


@pytest.mark.parametrize("statement", IMPORTS.values(), ids=IMPORTS)
def test_every_way_to_import_is_seen(tree: Path, statement: str) -> None:
    (tree / "work.py").write_text(statement)
    forget()
    assert digest_after(tree / "group" / "inner.py", "TWO = 2", "TWO = 3")


def test_relative_imports_of_a_package_and_from_above(tree: Path) -> None:
    (tree / "work.py").write_text("import texloom.stages.group")
    (tree / "group" / "__init__.py").write_text("from . import inner\nfrom .. import deeper")
    forget()
    assert digest_after(tree / "group" / "inner.py", "TWO = 2", "TWO = 3")
    assert digest_after(tree / "deeper.py", "ONE = 1", "ONE = 3")


@pytest.mark.parametrize("name", ["work.html.j2", "helpers.css", "group/__init__.json"])
def test_data_files_of_a_module_count(tree: Path, name: str) -> None:
    (tree / "deeper.py").write_text("import texloom.stages.group\n")
    before = code_digest("texloom.stages.work")
    (tree / name).write_text("one")
    forget()
    assert code_digest("texloom.stages.work") != before
    assert digest_after(tree / name, "one", "two")


@pytest.mark.parametrize(
    "name", ["other.html.j2", "work", "work.pyi", "work.py.orig", ".work.html", "data/work.css"]
)
def test_other_files_do_not_count(tree: Path, name: str) -> None:
    (tree / "data").mkdir()
    before = code_digest("texloom.stages.work")
    (tree / name).write_text("one")
    forget()
    assert code_digest("texloom.stages.work") == before


def test_an_edit_of_a_template_changes_the_stages_that_use_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def digests() -> dict[str, str]:
        forget()
        return {name: code_digest(find_stage(name).module) for name in stage_names()}

    shutil.copytree(ROOT / "stages", tmp_path / "stages", ignore=shutil.ignore_patterns("__pycache__"))
    before = digests()
    monkeypatch.setattr(code_digests, "_ROOT", tmp_path)
    with_style = {name for name in stage_names() if name.endswith(("_report", ".report"))}
    with_style |= {"evaluation.regularity_preservation", "evaluation.sequence_methods"}
    for file, changed in (("report.html.j2", {"evaluation.report"}), ("_pages/page.css", with_style)):
        with (tmp_path / "stages" / "evaluation" / file).open("a") as template:
            template.write(" ")
        after = digests()
        assert {name for name in before if after[name] != before[name]} == changed
        before = after


def test_imports_in_a_ring(tree: Path) -> None:
    (tree / "deeper.py").write_text("import texloom.stages.work\nONE = 1\n")
    forget()
    assert digest_after(tree / "deeper.py", "ONE = 1", "ONE = 2")


def test_a_module_that_is_not_there(tree: Path) -> None:
    with pytest.raises(ModuleNotFoundError):
        code_digest("texloom.stages.nowhere")


def test_stages_count_the_kernels_they_call() -> None:
    assert "texloom.stages.kernels.patchmatch.search" in reached("texloom.stages.synthesis.optimisation.optimise")
    assert "texloom.stages.kernels.core.threads" in reached("texloom.stages.synthesis.optimisation.optimise")
    assert "texloom.stages.vocabulary.color" in reached("texloom.stages.analysis.structure.edges")
    assert not any("kernels.patchmatch" in name for name in reached("texloom.stages.analysis.structure.otsu"))


def reached(module: str) -> set[str]:
    """``module`` and all that it imports of texloom."""
    found, pending = set(), [module]
    while pending:
        name = pending.pop()
        if name not in found:
            found.add(name)
            pending.extend(code_digests.imports(name))
    return found


def test_digests_import_nothing() -> None:
    """Planning must not pay for compilers and libraries of pictures."""
    code = f"""
        import sys
        from texloom.pipelines.engine.code_digest import code_digest
        for module in {[find_stage(name).module for name in stage_names()]!r}:
            code_digest(module)
        print(*sorted(sys.modules))
    """
    loaded = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], check=True, capture_output=True, text=True, cwd=ROOT
    ).stdout.split()
    assert not {"numba", "cv2", "scipy", "skimage", "prefect", "OpenEXR", "PIL"} & set(loaded)
    assert not [name for name in loaded if name.startswith(tuple(f"texloom.stages.{g}." for g in GROUPS))]


EVERYTHING = r"""
import a.b as c
from .. import d
from e import (f, g as h)

@decorated(1, *two, **three)
class C(B, metaclass=M):
    x: int
    y: "text" = 0x10
    def m(self, a, /, b: int = 1, *args: T, c, d=None, **kwargs: U) -> V | None:
        global n
        return lambda x, *y, z=1, **w: (yield from x)
    def none(self): pass
async def co():
    async with p as q, r: await s
    async for t in u: continue
    else: del v, w[0]
    return [x async for x in y if z if w], {k: v for k, v in i}, {s for s in t}, (g for g in h)
for i, *j in (), [], {**k, 'l': None}: break
while not (m := n): n += 1; n @= 2; n //= ~3
try: raise E from None
except (F, G) as error: assert x, 'y'
except H: raise
else: pass
finally: pass
try: pass
except* K: nonsense
match o:
    case {'p': [1, *_], **rest} | Q(r, s=-1.5): t
    case None | True | u.v | 'w' | b'x' if y: z
    case (first, second) as both: ...
    case _: a if b else c
def outer():
    z = 0
    def inner(): nonlocal z
w[1:2, ::3, ...] = 1 < 2 <= 3 == 4 != 5 is 6 is not 7 in 8 not in 9
x = y = u'old' 'joined' "\N{BULLET}\ud800" + b'\x00', 1e999, 10**400, 1_000j, -0.0, True, ...
f'' ; f'a{b!r}c{d:>{e}.{f}}g{{h}}' 'i' f"{j!s:}{k=}{l = !a:5}" ; f"{m['n']}" f'{{' '' f'}}' ; rf'\d{o}'
f'''multi {
    q + 1
} line''' ; f'{r:%H:%M}{(lambda: 1)()}'
with (s as t, u): v = not w and x or y; z: int
print(*a, sep='', **b); c[*d] = e
"""


def test_digests_are_the_same_with_all_versions_of_python(tree: Path) -> None:
    """The value was found with 3.11, 3.12 and 3.13. Another one means that every store is computed again."""
    (tree / "work.py").write_text(EVERYTHING)
    forget()
    assert code_digests._summary("texloom.stages.work").syntax[:16] == "20bedc5d0dc70578"


@pytest.mark.parametrize(
    ("one", "other"),
    [("f(None)", "f()"), ("f([])", "f(())"), ("{**a}", "{None: a}"), ("1", "True"), ("1", "1.0"), ("'1'", "1"),
     ("f'{a}b'", "f'{a}' + 'b'"), ("f'{a!r}'", "f'{a!s}'"), ("f'{a:b}'", "f'{a}b'"), ("a[b]", "a[b:]"),
     ("-1", "~1"), ("[a, b]", "[[a], b]"), ("lambda a, b=c: 1", "lambda *, a, b=c: 1"), ("'a, b'", "'a', 'b'"),
     ("''", "[]")],
)  # fmt: skip
def test_what_differs_has_another_digest(tree: Path, one: str, other: str) -> None:
    (tree / "work.py").write_text(f"x = {one}")
    forget()
    assert digest_after(tree / "work.py", one, other)


# -- what is kept between processes


def never(*_: object) -> Any:
    raise AssertionError


def test_a_source_is_parsed_once_for_all_processes(tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    digest = code_digest("texloom.stages.work")
    forget()
    monkeypatch.setattr(code_digests, "_syntax", never)
    assert code_digest("texloom.stages.work") == digest


@pytest.mark.parametrize(("module", "old", "new"), COUNTS.values(), ids=COUNTS)
def test_what_is_kept_changes_no_digest(tree: Path, table: Path, module: str, old: str, new: str) -> None:
    assert digest_after(tree / f"{module}.py", old, new)
    with_table = code_digest("texloom.stages.work")
    table.unlink()
    forget()
    assert code_digest("texloom.stages.work") == with_table


def test_an_edit_at_the_same_time_of_the_same_length_is_seen(tree: Path) -> None:
    path = tree / "deeper.py"
    before, state = code_digest("texloom.stages.work"), path.stat()
    with path.open("r+") as file:
        file.write(DEEPER.replace("1", "2"))
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
    forget()
    assert code_digest("texloom.stages.work") != before


def test_the_same_text_as_another_module_imports_others(tree: Path) -> None:
    (tree / "group" / "helpers.py").write_text("TWO = 2\n")
    for path in (tree / "work.py", tree / "group" / "inner.py", tree / "group" / "__init__.py"):
        path.write_text("from . import helpers\n")
    for module, other in (
        ("texloom.stages.work", "texloom.stages.helpers"),
        ("texloom.stages.group.inner", "texloom.stages.group.helpers"),
        ("texloom.stages.group", "texloom.stages.group.helpers"),
    ):
        assert other in code_digests.imports(module)


def test_other_versions_keep_their_own(tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code_digest("texloom.stages.work")
    forget()
    monkeypatch.setattr(sys, "version", "other")
    monkeypatch.setattr(code_digests, "_syntax", never)
    with pytest.raises(AssertionError):
        code_digest("texloom.stages.work")


@pytest.mark.parametrize("how", ["altered", "cut", "empty", "no table", "a folder"])
def test_a_damaged_table_is_none(tree: Path, table: Path, how: str) -> None:
    digest = code_digest("texloom.stages.work")
    whole = table.read_bytes()
    at = whole.index(b'"texloom.stages.helpers"')
    damaged = {
        "altered": whole[: at + 8] + b"X" + whole[at + 9 :],
        "cut": whole[:-1],
        "empty": b"",
        "no table": b"[]",
    }
    table.unlink()
    if how == "a folder":
        table.mkdir()
    else:
        table.write_bytes(damaged[how])
    forget()
    assert code_digest("texloom.stages.work") == digest
    assert how == "a folder" or table.read_bytes() == whole


def test_without_a_place_for_it_nothing_is_kept(tree: Path, table: Path) -> None:
    table.parent.write_text("no folder")
    assert len(code_digest("texloom.stages.work")) == 64


def test_a_table_keeps_its_newest_entries() -> None:
    user_cache.save("numbers", {str(number): number for number in range(5)}, most=3)
    assert user_cache.load("numbers") == {"2": 2, "3": 3, "4": 4}
