"""The client of other programs and its server: pictures there and back, and all that can go wrong between them."""

from __future__ import annotations

import ast
import http.client
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest

from tests.bridge.conftest import COMMAND, QUICK
from tests.printed import next_line
from texloom.pipelines.bridge import client as client_file
from texloom.pipelines.bridge.client import CancelledError, Client, Pixels, RunHandle, TexloomError

FILE = Path(client_file.__file__)
SLOW: dict[str, Any] = {"size": 1024, "tileable": "both"}
"""options of `self_tuning` with which it is still at work when a test has looked"""
WITHOUT_NUMPY = """
import json, sys
sys.path.insert(0, sys.argv[1])
import texloom_client
assert "numpy" not in sys.modules
asked = json.load(sys.stdin)
with texloom_client.Client(**asked["server"]) as client:
    picture = texloom_client.Pixels(bytes(asked["data"]), tuple(asked["shape"]), "uint8")
    made = client.submit("quilting", {"exemplar": picture}, **asked["how"]).wait(300)
print(json.dumps([list(made.maps["albedo"].data), made.maps["albedo"][1:], sys.version]))
"""
"""a program that has the client's file alone"""


def quilted(client: Client, picture: Any, **options: Any) -> np.ndarray:
    run = client.submit("quilting", {"exemplar": picture}, **(QUICK | options))
    made: np.ndarray = run.wait(300).maps["albedo"].numpy()
    return made


def test_the_bits_are_those_of_the_command(client: Client, picture: np.ndarray, tmp_path: Path) -> None:
    PIL.Image.fromarray(picture).save(tmp_path / "mine.png")
    command = ["run", "quilting", "mine.png", "--size", "48", "--seed", "3", "--set", "texture.block=16"]
    subprocess.run(
        [*COMMAND, *command, "--store", "own", "--out", "out"], cwd=tmp_path, check=True, capture_output=True
    )
    wanted = np.asarray(PIL.Image.open(tmp_path / "out" / "texture.png"))
    for given in (picture, tmp_path / "mine.png", ("mine.png", (tmp_path / "mine.png").read_bytes())):
        files = ("texture.png", "scores.json")
        made = client.submit("quilting", {"exemplar": given}, {"texture.block": 16}, **QUICK, files=files).wait(300)
        np.testing.assert_array_equal(made.maps["albedo"].numpy(), wanted)
        exported = PIL.Image.open(io.BytesIO(made.files["texture.png"]))
        np.testing.assert_array_equal(np.asarray(exported), wanted)
        assert made.scores.items() <= json.loads(made.files["scores.json"])["summary"].items()


@pytest.mark.parametrize(
    ("dtype", "space"),
    [(np.uint8, "srgb"), (np.uint16, "srgb"), (np.float32, "linear"), (np.dtype(">f4"), "linear")],
)
def test_results_are_as_what_was_sent(client: Client, picture: np.ndarray, dtype: Any, space: str) -> None:
    given = picture.astype(dtype) if np.dtype(dtype).kind == "u" else (picture / 255).astype(dtype)
    made = client.submit("quilting", {"exemplar": given}, **QUICK).wait(300).maps["albedo"]
    assert (made.shape, made.dtype, made.color_space) == ((48, 48, 3), np.dtype(dtype).name, space)
    here = np.unique(given.reshape(-1, 3).astype(np.float64), axis=0)
    there = np.unique(made.numpy().reshape(-1, 3).astype(np.float64), axis=0)
    assert len(there) > 100
    blended = [row for row in there if np.abs(here - row).sum(1).min() > (2 if space == "srgb" else 1e-5)]
    assert len(blended) < 0.5 * len(there)  # the others are the exemplar's, as they were


def test_maps_of_a_material_keep_their_kinds(client: Client, picture: np.ndarray) -> None:
    height = picture[..., 0].astype(np.uint16) * 257
    maps = {"albedo": picture, "height": height, "normal": np.full_like(picture, (128, 128, 255))}
    made = client.submit("materials", {"exemplar": maps}, size=64, preset="fast").wait(600)
    told = {name: (one.shape, one.dtype, one.color_space) for name, one in made.maps.items()}
    assert told == {
        "albedo": ((64, 64, 3), "uint8", "srgb"),
        "height": ((64, 64), "uint16", "data"),
        "normal": ((64, 64, 3), "uint8", "data"),
    }
    assert any(name.startswith("maps/") for name in made.names)


def test_exports_by_pattern_in_the_layout_that_was_asked_for(client: Client, picture: np.ndarray) -> None:
    maps = {"albedo": picture, "height": picture[..., 0]}
    options = {"size": 64, "preset": "fast", "layout": "blender", "texel_size": "2mm"}
    made = client.submit("materials", {"exemplar": maps}, files=("maps/*",), **options).wait(600)
    assert sorted(made.files) == [one for one in made.names if one.startswith("maps/")]
    (document,) = [one for name, one in made.files.items() if name.endswith(".usda")]
    assert f"inputs:scale = ({0.05 * 64 * 0.002:g}," in document.decode()  # height in metres


def test_several_pictures_have_numbers_for_names(client: Client, picture: np.ndarray, tmp_path: Path) -> None:
    """Raw ones; files have their own. The result is as the deepest of them."""
    other = 255 - picture
    PIL.Image.fromarray(other[:40]).save(tmp_path / "grass.png")
    given = [picture, picture, ("grass.png", (tmp_path / "grass.png").read_bytes()), other.astype(np.uint16) * 257]
    params = {"sheet.weights": {"1": 2, "grass": 1}}
    options = {"size": 64, "preset": "fast", "files": ("exemplars.json",)}
    made = client.submit("remix", {"exemplars": given}, params, **options).wait(600)
    assert (made.maps["albedo"].shape, made.maps["albedo"].dtype) == ((64, 64, 3), "uint16")
    told = json.loads(made.files["exemplars.json"])
    assert sorted(one["name"] for one in told["exemplars"]) == ["1", "2", "4", "grass"]


def test_several_materials(client: Client, picture: np.ndarray) -> None:
    """The maps that all have."""
    first = {"albedo": picture, "height": picture[..., 0], "roughness": picture[..., 1]}
    second = {"albedo": picture[::-1].copy(), "roughness": picture[..., 2]}
    options = {"size": 64, "preset": "fast"}
    made = client.submit("remix", {"exemplars": [first, second]}, **options).wait(600)
    assert {name: one.shape for name, one in made.maps.items()} == {"albedo": (64, 64, 3), "roughness": (64, 64)}


def test_a_large_picture(client: Client, picture: np.ndarray) -> None:
    large = np.tile(picture, (64, 64, 1))
    assert large.shape == (4096, 4096, 3)
    np.testing.assert_array_equal(quilted(client, large, crop="64x64+128+64"), quilted(client, picture))


# -- Python


def test_the_file_is_python_3_9_without_dependencies(tmp_path: Path) -> None:
    written = subprocess.run([*COMMAND, "client"], check=True, capture_output=True).stdout
    assert written == FILE.read_bytes()
    tree = ast.parse(written, feature_version=(3, 9))
    imported = {
        name.split(".")[0]
        for node in ast.walk(tree)
        for name in (
            [one.name for one in node.names] if isinstance(node, ast.Import)
            else [node.module or ""] if isinstance(node, ast.ImportFrom)
            else []
        )
    }  # fmt: skip
    assert imported - sys.stdlib_module_names == {"numpy"}  # where there is one, for `Pixels.numpy`


def _python(minor: int) -> str | None:
    """A Python 3.`minor` that runs."""
    folders = (Path.home() / ".pyenv" / "versions", Path.home() / ".local" / "share" / "uv" / "python")
    found = [str(one) for folder in folders for one in folder.glob(f"*3.{minor}.*/bin/python3.{minor}")]
    for python in filter(None, (shutil.which(f"python3.{minor}"), *found)):
        if subprocess.run([python, "-c", ""], capture_output=True, check=False).returncode == 0:
            return python
    return None


@pytest.mark.parametrize("minor", range(9, 15))
def test_pythons(minor: int, client: Client, store: str, picture: np.ndarray, tmp_path: Path) -> None:
    python = _python(minor)
    if python is None:
        pytest.skip(f"no Python 3.{minor} on the PATH, in pyenv or in uv")
    shutil.copy(FILE, tmp_path / "texloom_client.py")
    server: dict[str, Any] = dict(zip(("address", "token"), client._ready(), strict=True))
    if minor in (9, 13):  # these start one
        server = {"command": COMMAND, "store": store}
    asked = {"server": server, "data": list(picture.tobytes()), "shape": picture.shape, "how": QUICK}
    program = [python, "-S", "-c", WITHOUT_NUMPY, str(tmp_path)]
    done = subprocess.run(program, input=json.dumps(asked), text=True, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    data, (shape, dtype, space), version = json.loads(done.stdout)
    assert version.startswith(f"3.{minor}.")
    assert (dtype, space) == ("uint8", "srgb")
    np.testing.assert_array_equal(np.array(data, np.uint8).reshape(shape), quilted(client, picture))


def test_texloom_is_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("TEXLOOM", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    monkeypatch.setenv("UV_TOOL_DIR", str(tmp_path / "tools"))
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    with pytest.raises(TexloomError, match="texloom is not found; install it"):
        client_file.find_texloom()
    places = [tmp_path / "tools" / "texloom" / "bin", tmp_path / ".local" / "bin", tmp_path / "on_path"]
    monkeypatch.setenv("PATH", str(places[2]))
    for place in places:  # the later ones come first
        place.mkdir(parents=True)
        (place / "texloom").touch(0o755)
        assert client_file.find_texloom() == [str(place / "texloom")]
    monkeypatch.setenv("TEXLOOM", str(places[0] / "texloom"))
    assert client_file.find_texloom() == [str(places[0] / "texloom")]
    assert client_file.find_texloom(["uvx", "texloom"]) == ["uvx", "texloom"]
    monkeypatch.setenv("TEXLOOM", "/no/such/texloom")
    with pytest.raises(TexloomError, match="/no/such/texloom: no such program"):
        client_file.find_texloom()


# -- what goes on while a host does something else


def test_a_host_is_told_and_can_look(store: str, picture: np.ndarray) -> None:
    told: list[str] = []
    with Client(COMMAND, store=store) as client:
        run = client.submit(
            "quilting", {"exemplar": picture}, **QUICK, callback=lambda run: told.append(run.poll().state)
        )
        assert run.poll().state == "starting"
        with pytest.raises(TimeoutError):
            run.wait(0)
        run.wait(300)
    assert told[-1] == "done"
    assert told.count("done") == 1
    with pytest.raises(TexloomError, match="the client is closed"):
        quilted(client, picture)


def test_a_run_shows_pictures_and_is_cancelled(client: Client, picture: np.ndarray) -> None:
    run = client.submit("self_tuning", {"exemplar": picture}, **SLOW, seed=1)
    waiting = client.submit("self_tuning", {"exemplar": picture}, **SLOW, seed=2)
    while run.preview() is None:
        assert not run.poll().has_ended
        time.sleep(0.02)
    preview = run.preview()
    assert preview is not None
    assert preview.shape[2] == 4
    assert len(preview.data) == np.prod(preview.shape)
    assert run.poll().state == "running"
    assert run.poll().step
    for one in (waiting, run):
        one.cancel()
        with pytest.raises(CancelledError):
            one.wait(60)
    assert quilted(client, picture).shape == (48, 48, 3)


def test_runs_are_made_in_the_order_in_which_they_were_submitted(client: Client, picture: np.ndarray) -> None:
    """Also where the first has more to send."""
    ended: list[int] = []

    def note(run: RunHandle) -> None:
        if run.poll().has_ended:
            ended.append(runs.index(run))

    large = np.tile(picture, (12, 12, 1))
    runs: list[RunHandle] = []
    for given in (large, picture, picture):
        runs.append(client.submit("quilting", {"exemplar": given}, size=48, seed=len(runs), callback=note))
    for run in runs:
        run.wait(120)
    assert ended == [0, 1, 2]


def test_a_killed_server_is_started_again(store: str, picture: np.ndarray) -> None:
    with Client(COMMAND, store=store) as client:
        run = client.submit("self_tuning", {"exemplar": picture}, size=256, preset="fast", seed=5)
        while run.poll().state != "running":
            assert not run.poll().has_ended
            time.sleep(0.02)
        killed = client._process
        assert killed is not None
        killed.kill()
        assert run.wait(600).maps["albedo"].shape == (256, 256, 3)
        assert client._process is not killed
        assert client._process is not None
        client._process.kill()
        assert quilted(client, picture).shape == (48, 48, 3)
    assert client._process is None


def test_the_server_ends_with_its_host(store: str, tmp_path: Path) -> None:
    host = (
        "import sys, time; sys.path.insert(0, sys.argv[1]); import client\n"
        f"one = client.Client({COMMAND!r}, store={store!r}); one.hello(); print(one._process.pid, flush=True)\n"
        "time.sleep(600)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", host, str(FILE.parent)], stdout=subprocess.PIPE, text=True
    ) as process:
        server = int(next_line(process))
        os.kill(server, 0)
        process.send_signal(signal.SIGKILL)
    for _ in range(600):
        if not Path(f"/proc/{server}/stat").exists() and not _is_alive(server):
            return
        time.sleep(0.1)
    pytest.fail("the server goes on without its host")


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def test_two_clients_at_once(client: Client, picture: np.ndarray) -> None:
    address, token = client._ready()
    pictures = [picture, picture[::-1].copy()]
    wanted = [quilted(client, one) for one in pictures]
    both = [Client(address=address, token=token) for _ in pictures]
    runs: list[list[RunHandle]] = [[], []]

    def submit(number: int) -> None:
        for seed in (3, 4):
            options = QUICK | {"seed": seed}
            runs[number].append(both[number].submit("quilting", {"exemplar": pictures[number]}, **options))

    threads = [threading.Thread(target=submit, args=(number,)) for number in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for own, expected in zip(runs, wanted, strict=True):
        np.testing.assert_array_equal(own[0].wait(300).maps["albedo"].numpy(), expected)
        assert (own[1].wait(300).maps["albedo"].numpy() != expected).any()


# -- what is refused, in one line


@pytest.mark.parametrize(
    ("flow", "sources", "options", "problem"),
    [
        ("no_such", {}, {}, "no_such: no such flow"),
        ("quilting", {"exemplar": "/no/such.png"}, {}, "sources.exemplar: /no/such.png: no such file"),
        ("quilting", {"exemplr": "texloom:bricks"}, {}, "did you mean 'exemplar'?"),
        ("quilting", {"exemplar": 3}, {}, "a source of type int: give a path, Pixels or a NumPy array"),
        ("quilting", {"exemplar": np.zeros((8, 8, 3))}, {}, "dtype: float64: Input should be 'uint8', 'uint16' or"),
        ("quilting", {"exemplar": np.zeros((8, 8, 2), np.uint8)}, {}, "exemplar"),
        ("quilting", {"exemplar": np.zeros((8, 0, 3), np.uint8)}, {}, "shape: "),
        ("remix", {"exemplars": []}, {}, "sources.exemplars"),
        ("remix", {"exemplars": [np.zeros((8, 8), np.uint8)] * 2}, {}, "8 x 8 px is too small"),
        ("quilting", {"exemplar": Pixels(b"abc", (8, 8), "uint8")}, {}, "shape: 8,8 of uint8 are 64 bytes, but"),
        ("quilting", {"exemplar": Pixels(b"a" * 64, (8, 8), "uint8", "linear")}, {}, "color_space: uint8 is srgb"),
        ("quilting", {"exemplar": ("../a.png", b"")}, {}, "name: ../a.png is no name of a file"),
        ("quilting", {"exemplar": ("a.png", b"abc")}, {}, "exemplar: a.png: is not a picture that can be"),
        ("quilting", {"exemplar": {"colour of what": np.zeros((8, 8), np.uint8)}}, {}, "is not the name of a map"),
        ("quilting", {"exemplar": "texloom:bricks"}, {"size": "big"}, "must be N or WIDTHxHEIGHT"),
        ("quilting", {"exemplar": "texloom:bricks"}, {"sise": 3}, "sise: Extra inputs are not permitted"),
        ("quilting", {"exemplar": "texloom:bricks"}, {"tileable": "maybe"}, "tileable: Input should be 'off', 'x'"),
        ("quilting", {"exemplar": "texloom:bricks"}, {"files": ("no.exr",), **QUICK}, "no.exr: the run exports"),
    ],
)  # fmt: skip
def test_a_wrong_request(client: Client, flow: str, sources: Any, options: Any, problem: str) -> None:
    run = client.submit(flow, sources, **options)
    with pytest.raises(TexloomError) as raised:
        run.wait(300)
    text = str(raised.value)
    assert problem in text
    assert "\n" not in text.strip()
    assert "Traceback" not in text
    assert "texloom-studio" not in text  # the server's own folder
    assert run.poll().state == "failed"


def test_a_wrong_token(client: Client) -> None:
    address, token = client._ready()
    for wrong in ("", token[:-1], "wrong"):
        with pytest.raises(TexloomError, match="the token is wrong: read it from"):
            Client(address=address, token=wrong).hello()


def test_other_versions_and_pages(client: Client) -> None:
    place, token = client._ready()
    own = {"Authorization": f"Bearer {token}", "X-Texloom-Protocol": "1"}
    cases: list[tuple[str, str, dict[str, str], int, str]] = [
        ("GET", "/hello", own, 200, '"protocol":1'),
        (
            "GET",
            "/hello",
            own | {"X-Texloom-Protocol": "2"},
            426,
            "this texloom speaks protocol 1, the client 2; write",
        ),
        ("GET", "/hello", own | {"Origin": "http://example.com"}, 403, "Requests of other pages are refused."),
        ("GET", "/hello", own | {"Host": "example.com"}, 403, "This server answers to 127.0.0.1"),
        ("GET", "/runs/none", own, 404, "/runs/none: there is no such thing"),
        ("GET", "/runs/none/files/../../x", own, 404, "there is no such thing"),
        ("GET", "/api/start", own, 404, "there is no such thing"),
        ("POST", "/runs", own | {"Content-Length": str(2**21)}, 413, "larger than"),
    ]
    for method, path, headers, status, text in cases:
        connection = http.client.HTTPConnection(place.removeprefix("http://"))
        connection.putrequest(method, path, skip_host="Host" in headers)
        for header in headers.items():
            connection.putheader(*header)
        connection.endheaders()
        answer = connection.getresponse()
        said = answer.read().decode()
        assert (answer.status, text in said) == (status, True), (path, said)
        assert len(said.strip().splitlines()) == 1
        connection.close()


def _program(folder: Path, text: str) -> list[str]:
    (folder / "program.py").write_text(text)
    return [sys.executable, str(folder / "program.py")]


def test_a_server_that_does_not_start(tmp_path: Path) -> None:
    for program, problem in {
        "import sys; print('a traceback', file=sys.stderr); sys.exit('it is broken')":
            "serve does not start: it is broken",
        "print('no JSON')": "does not start: it says nothing",
        "print('{\"protocol\": 2, \"version\": \"9\", \"address\": \"\", \"token\": \"\"}')":
            "texloom 9 speaks protocol 2, this file 1; write it anew: texloom client > texloom_client.py",
    }.items():  # fmt: skip
        with Client(_program(tmp_path, program)) as client, pytest.raises(TexloomError) as raised:
            client.submit("quilting", {}).wait(60)
        assert problem in str(raised.value)


def test_a_server_that_always_ends(tmp_path: Path) -> None:
    """Its host is told after a few, not never."""
    line = '{"protocol": 1, "version": "1", "address": "http://127.0.0.1:9", "token": ""}'
    problem = "the server has ended, 3 times: ConnectionRefusedError"
    with Client(_program(tmp_path, f"print('{line}')")) as client, pytest.raises(TexloomError, match=problem):
        client.submit("quilting", {}).wait(60)
