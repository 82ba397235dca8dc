"""What is packed and installed: `texloom` and nothing else, however it gets there."""

from __future__ import annotations

import ast
import email
import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.conftest import ROOT

FOLDERS = ("configs", "pipelines", "stages")
OWN = ROOT / ".import" / "texloom"


def packed() -> set[str]:
    """The files that belong into the package."""
    top = {f"texloom/{path.name}" for path in OWN.iterdir() if path.is_file()}
    inside = {
        f"texloom/{path.relative_to(ROOT)}"
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and not {"__pycache__", "node_modules"} & {*path.parts}
    }
    return top | inside


CLIENT = "texloom/pipelines/studio/client/"
"""what the page of the studio is built from, which is not installed"""


def python(*arguments: str, at: Path, path: Path | None = None) -> str:
    """What Python prints; ``path`` comes before all that is installed."""
    environment = {**os.environ, "PYTHONPATH": str(path or "")}
    environment.pop("PYTHONSAFEPATH", None)  # which commands set that other tests ran in this process
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, check=False, cwd=at, env=environment
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def build(source: Path, out: Path, *targets: str) -> list[Path]:
    """Build as `pip` and `python -m build` do, without a new environment and so without a network."""
    pytest.importorskip("hatchling")
    for target in targets:
        code = f"from hatchling.build import *; print({target}({str(out)!r}))"
        python("-c", code, at=source, path=_hatchling())
    return sorted(out.iterdir())


def _hatchling() -> Path:
    import hatchling

    return Path(hatchling.__file__).parents[1]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A wheel and an sdist of the repository."""
    wheel, sdist = build(ROOT, tmp_path_factory.mktemp("dist"), "build_wheel", "build_sdist")
    return wheel, sdist


@pytest.fixture(scope="module")
def site(built: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which the wheel has been installed."""
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(built[0]) as wheel:
        wheel.extractall(folder)
    return folder


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A user's folder with packages of the names that the repository's folders have."""
    for name in FOLDERS:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('the wrong package')\n")
    return tmp_path


def test_wheel_holds_the_package_alone(built: tuple[Path, Path]) -> None:
    with zipfile.ZipFile(built[0]) as wheel:
        names = set(wheel.namelist())
        installed = {name for name in packed() if not name.startswith(CLIENT)}
        assert {name for name in names if ".dist-info/" not in name} == installed
        assert "texloom/pipelines/studio/page/index.html" in names
        assert {name.partition("/")[0] for name in names} == {"texloom", "texloom-0.1.0.dist-info"}
        metadata = email.message_from_bytes(wheel.read("texloom-0.1.0.dist-info/METADATA"))
    assert metadata["Name"] == "texloom"
    assert {"texloom/py.typed", "texloom/stages/references.bib", "texloom/configs/self_tuning.yaml"} <= names
    assert any(name.endswith("contours.npz") for name in names)


def test_wheel_holds_its_licence_and_bill_of_materials(built: tuple[Path, Path]) -> None:
    """Of CycloneDX the parts that are required, and each dependency with a licence."""
    with zipfile.ZipFile(built[0]) as wheel:
        assert wheel.read("texloom-0.1.0.dist-info/licenses/LICENSE") == (ROOT / "LICENSE").read_bytes()
        bill = json.loads(wheel.read("texloom-0.1.0.dist-info/sboms/texloom.cdx.json"))
        metadata = email.message_from_bytes(wheel.read("texloom-0.1.0.dist-info/METADATA"))
    assert (bill["bomFormat"], bill["specVersion"], bill["metadata"]["component"]["purl"]) == (
        "CycloneDX",
        "1.6",
        "pkg:pypi/texloom@0.1.0",
    )
    needed = [one for one in metadata.get_all("Requires-Dist", []) if "extra ==" not in one]
    python_components = [one for one in bill["components"] if one["purl"].startswith("pkg:pypi/")]
    assert [Requirement(one["properties"][0]["value"]) for one in python_components] == sorted(
        map(Requirement, needed), key=str
    )
    page = json.loads((ROOT / "pipelines/studio/client/package.json").read_text())["dependencies"]
    assert set(page) <= {one["name"] for one in bill["components"] if one not in python_components}
    assert all(one["licenses"][0]["expression"] for one in bill["components"])
    assert bill["dependencies"][0]["dependsOn"] == [one["bom-ref"] for one in bill["components"]]


def test_the_lock_file_fits_what_is_declared() -> None:
    """All that the development install needs is pinned, to a version that is permitted."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    pinned = {}
    lines = (ROOT / "requirements.lock").read_text().replace("\\\n", "").splitlines()
    for line in lines:
        wanted, *hashes = line.split(" --hash=")
        assert hashes, line
        assert all(re.fullmatch(r"sha256:[0-9a-f]{64}\s*", one) for one in hashes), line
        requirement = Requirement(wanted.strip())
        if requirement.marker is None or requirement.marker.evaluate():
            pinned[canonicalize_name(requirement.name)] = next(iter(requirement.specifier)).version
    declared = [
        *project["dependencies"],
        *project["optional-dependencies"]["test"],
        *project["optional-dependencies"]["dev"],
    ]
    for requirement in map(Requirement, declared):
        if requirement.name != "texloom":
            assert pinned[canonicalize_name(requirement.name)] in requirement.specifier, requirement


def test_what_is_imported_is_declared() -> None:
    """Not only brought by another package, which may do without it one day."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"].values()
    declared = {canonicalize_name(Requirement(one).name) for one in chain(project["dependencies"], *extras)}
    owners = importlib.metadata.packages_distributions()
    imported = set()
    for path in chain.from_iterable((ROOT / room).rglob("*.py") for room in ("stages", "pipelines")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {one.name.partition(".")[0] for one in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add(str(node.module).partition(".")[0])
    others = imported - {*sys.stdlib_module_names, "texloom"}
    assert others > {"numpy", "httpx", "llvmlite"}
    for name in others & owners.keys():
        assert {canonicalize_name(owner) for owner in owners[name]} & declared, name


def test_sdist_holds_the_package_alone(built: tuple[Path, Path]) -> None:
    with tarfile.open(built[1]) as sdist:
        assert all(member.isfile() for member in sdist), "links must be followed"
        names = {member.name.removeprefix("texloom-0.1.0/") for member in sdist}
    metadata = {"PKG-INFO", "LICENSE", "README.md", "pyproject.toml", "hatch_build.py", ".gitignore"}
    assert names == packed() | metadata


def test_wheel_of_the_sdist_is_the_same(built: tuple[Path, Path], tmp_path: Path) -> None:
    with tarfile.open(built[1]) as sdist:
        if hasattr(tarfile, "data_filter"):  # not in Python 3.11.2
            sdist.extraction_filter = tarfile.data_filter
        sdist.extractall(tmp_path)
    (again,) = build(tmp_path / "texloom-0.1.0", tmp_path / "dist", "build_wheel")
    with zipfile.ZipFile(built[0]) as first, zipfile.ZipFile(again) as second:
        assert {name: first.read(name) for name in first.namelist()} == {
            name: second.read(name) for name in second.namelist()
        }


def test_without_npm_an_editable_install_works_and_a_wheel_is_refused(tmp_path: Path) -> None:
    """A wheel without the page of the studio would be broken; a clone says how to build it."""
    clone = tmp_path / "clone"
    wanted = {".import", *FOLDERS, "pyproject.toml", "hatch_build.py", "README.md", "LICENSE"}
    shutil.copytree(
        ROOT, clone, symlinks=True,
        ignore=lambda folder, names: (
            {name for name in names if name not in wanted} if Path(folder) == ROOT
            else {name for name in names if name in ("node_modules", "page", "__pycache__")}
        ),
    )  # fmt: skip
    for target, code in {"build_editable": 0, "build_wheel": 1}.items():
        done = subprocess.run(
            [sys.executable, "-c", f"from hatchling.build import *; print({target}({str(tmp_path)!r}))"],
            capture_output=True, text=True, check=False, cwd=clone,
            env={"PATH": "", "PYTHONPATH": str(_hatchling())},
        )  # fmt: skip
        assert done.returncode == code, done.stderr
        assert "the page of the studio cannot be built: there is no npm" in done.stdout + done.stderr


def test_editable_install_points_to_the_clone(tmp_path: Path) -> None:
    (wheel,) = build(ROOT, tmp_path, "build_editable")
    with zipfile.ZipFile(wheel) as editable:
        paths = [name for name in editable.namelist() if name.endswith(".pth")]
        assert len(paths) == 1
        assert editable.read(paths[0]).decode().strip() == str(ROOT / ".import")
        assert not [name for name in editable.namelist() if name.endswith(".py")]


def test_installed_package_runs_beside_packages_of_the_same_names(site: Path, project: Path) -> None:
    assert python("-c", "import texloom; print(texloom.__file__)", at=project, path=site).startswith(str(site))
    assert python("-m", "texloom", "--version", at=project, path=site) == "texloom, version 0.1.0"
    assert "self_tuning" in python("-m", "texloom", "flows", at=project, path=site)
    assert "texture" in python("-m", "texloom", "plan", "self_tuning", at=project, path=site)
    code = "import numpy as np, texloom; print(texloom.stages.otsu(np.eye(32, dtype=np.float32)).structure.shape)"
    assert python("-c", code, at=project, path=site) == "(32, 32)"
    loaded = "import sys, texloom.pipelines.api; print(sorted({'stages', 'pipelines', 'configs'} & {*sys.modules}))"
    assert python("-c", loaded, at=project, path=site) == "[]"


def test_clone_without_links_is_imported(project: Path, tmp_path: Path) -> None:
    """As Git makes it on Windows for a user who may not make links: text files that name the targets."""
    clone = tmp_path / "clone"
    for name in FOLDERS:
        shutil.copytree(ROOT / name, clone / name, ignore=shutil.ignore_patterns("__pycache__", "node_modules"))
    own = clone / ".import" / "texloom"
    own.mkdir(parents=True)
    for path in OWN.iterdir():
        if path.is_symlink():
            (own / path.name).write_text(str(path.readlink()))
        elif path.is_file():
            shutil.copy(path, own)
    code = "import texloom.stages.vocabulary.declare as one; print(one.__file__)"
    assert python("-c", code, at=project, path=clone / ".import") == str(
        clone / "stages" / "vocabulary" / "declare.py"
    )
    assert python("-m", "texloom", "--version", at=project, path=clone / ".import") == "texloom, version 0.1.0"
    assert "quilting" in python("-m", "texloom", "flows", at=project, path=clone / ".import")


def test_package_without_links_or_folders_says_so(tmp_path: Path) -> None:
    shutil.copytree(OWN, tmp_path / "texloom", ignore=shutil.ignore_patterns("__pycache__", *FOLDERS))
    with pytest.raises(AssertionError, match="pip install -e"):
        python("-c", "import texloom", at=tmp_path)


@pytest.mark.parametrize(
    "statement",
    [
        "import stages.vocabulary.color",
        "import pipelines",
        "from pipelines import api",
        "from stages.vocabulary.color import lab_from_linear",
    ],
)
def test_bare_imports_are_refused(statement: str) -> None:
    """Under two names a module would be loaded twice."""
    pytest.importorskip("ruff")
    done = subprocess.run(
        [sys.executable, "-m", "ruff", "check", "--stdin-filename", "stages/new.py", "-"],
        input=statement, capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    assert "TID251" in done.stdout, done.stderr


def test_scripts_of_users_are_type_checked(project: Path) -> None:
    pytest.importorskip("mypy")
    (project / "script.py").write_text(
        "import numpy as np\n"
        "import texloom\n"
        "made = texloom.synthesize(np.zeros((64, 64, 3), np.uint8), size=(64, 96), tileable=True)\n"
        "reveal_type(made.image)\n"
        "reveal_type(texloom.run('self_tuning', seed=3).exports)\n"
        "texloom.stages.quilting(made.image, size=(64, 64))\n"
        "texloom.synthesise('a.png')\n"
        "texloom.synthesize('a.png', sise=3)\n"
        "try:\n"
        "    texloom.plan('self_tuning')\n"
        "except texloom.InputError as error:\n"
        "    print(error)\n"
    )
    command = ["-m", "mypy", "--strict", "--cache-dir", str(ROOT / ".mypy_cache" / "scripts"), "script.py"]
    done = subprocess.run([sys.executable, *command], capture_output=True, text=True, check=False, cwd=project)
    said = [line for line in done.stdout.splitlines() if "defined in" not in line]
    assert [line.split(":")[1] for line in said[:-1]] == ["4", "5", "7", "8"], done.stdout
    assert "numpy.ndarray" in said[0]
    assert "dict[str, pathlib.Path]" in said[1]
    assert "has no attribute" in said[2]
    assert "Unexpected keyword argument" in said[3]
