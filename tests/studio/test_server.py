"""The server without a browser: who may talk to it, what it accepts, and what it makes."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import gzip
import http.client
import io
import json
import os
import shlex
import shutil
import signal
import time
import urllib.request
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import PIL.Image
import pytest
import websockets
import yaml

from tests.studio.conftest import Served, exemplar, run_again
from tests.studio.sockets import Page
from texloom.pipelines.store import codec
from texloom.pipelines.studio import processes
from texloom.pipelines.studio.messages.message import numbered, packed
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.messages.requests import PreviewRequest
from texloom.pipelines.studio.work import PictureWork, Places, RunWork
from texloom.pipelines.studio.work_loop import WorkLoop
from texloom.stages.vocabulary.declare import InputError

RECIPE = {
    "flow": "quilting",
    "sources": {"exemplar": "folder:blotches.png"},
    "size": "64x48",
    "seed": 3,
}


def png(image: Any) -> bytes:
    buffer = io.BytesIO()
    PIL.Image.fromarray(image).save(buffer, "PNG")
    return buffer.getvalue()


def connected(served: Served, **headers: str) -> Page:
    return Page(served.base, headers.pop("Cookie", served.cookie), **headers)


def finished(served: Served, recipe: dict[str, Any]) -> dict[str, Any]:
    """A run, when it has ended; told by the socket."""
    job = served.json("/api/jobs", recipe)
    with connected(served) as page:
        for message, _ in page.messages():
            told = message["job"] if message["kind"] == "job_changed" else {}
            if told.get("id") == job["id"] and told["state"] not in ("waiting", "running"):
                return told
    raise AssertionError


def preview(page: Page, number: int, recipe: dict[str, Any]) -> None:
    page.send(PreviewRequest(number=number, recipe=Recipe.model_validate(recipe)))


# -- who may talk to it


@pytest.mark.parametrize("path", ["/", "/studio.js", "/api/start", "/api/pictures?id=texloom:bricks", "/nothing"])
def test_nothing_is_answered_without_the_cookie(served: Served, path: str) -> None:
    name, _, value = served.cookie.partition("=")
    other = name.replace(str(served.port), str(served.port - 1))
    for cookie in ("", name, f"{name}=wrong", served.cookie[:-1], f"{other}={value}", f"other={value}"):
        assert served.request(path, cookie=cookie)[0] == 401, cookie
    assert served.request(f"{path.partition('?')[0]}?code={value}", cookie="")[0] == 401


def test_an_address_opens_the_page_in_one_browser(served: Served) -> None:
    address = served.new_address()
    path = address.removeprefix(served.base)
    assert served.request(f"/api/start{path.removeprefix('/')}", cookie="")[0] == 401
    assert served.request(path, method="HEAD", cookie="")[0] == 401
    with urllib.request.urlopen(address) as answer:
        assert answer.headers["set-cookie"].startswith(f"{served.cookie};")
    status, told = served.request(path, cookie="")
    assert status == 401
    assert f"{served.base}/ without it" in told.decode()
    assert "open the newest address in the terminal" in told.decode()
    assert b'url=/"' in served.request(path)[1]  # in the browser that has the cookie
    later = served.new_address()
    assert later != address
    with urllib.request.urlopen(later) as answer:
        assert answer.status == 200


@pytest.mark.parametrize(
    "others",
    [
        'a b=c; {"x":1}; %s',
        '{"x":1}; texloom-1=x; %s; d="',
        "%s;;=;a",
        "texloom-PORT=of-a-narrower-path; %s",
        "\xff=\xe4; %s",
    ],
)
def test_cookies_of_other_servers_do_not_matter(served: Served, others: str) -> None:
    """Browsers send those of all ports of this machine, whatever they hold."""
    cookies = others.replace("PORT", str(served.port)) % served.cookie
    for path in ("/", "/studio.js", "/api/start"):
        assert served.request(path, cookie=cookies)[0] == 200
    with connected(served, Cookie=cookies) as page:
        page.socket.ping().wait(10)
    without = cookies.replace(served.cookie, "x")
    assert served.request("/api/start", cookie=without)[0] == 401
    with pytest.raises(websockets.InvalidStatus):
        connected(served, Cookie=without)


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "texloom.example"},
        {"Host": "127.0.0.1"},
        {"Host": "127.0.0.1:1"},
        {"Origin": "http://texloom.example"},
        {"Origin": "null"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
    ],
    ids=str,
)
def test_other_hosts_and_pages_are_refused(served: Served, headers: dict[str, str]) -> None:
    assert served.request("/api/start", **headers)[0] == 403


@pytest.mark.parametrize(
    "headers",
    [
        {"Cookie": "texloom=wrong"},
        {"Origin": "http://texloom.example"},
    ],
    ids=str,
)
def test_the_socket_needs_cookie_and_origin(served: Served, headers: dict[str, str]) -> None:
    with pytest.raises(websockets.InvalidStatus) as refused:
        connected(served, **headers)
    assert refused.value.response.status_code == 403


def test_answers_forbid_what_the_page_does_not_need(served: Served) -> None:
    with urllib.request.urlopen(served.new_address()) as answer:
        assert "default-src 'none'" in answer.headers["content-security-policy"]
        cookie = answer.headers["set-cookie"]
        assert cookie.startswith(f"texloom-{served.port}=")
        assert {"httponly", "samesite=strict", "path=/"} <= {part.strip().lower() for part in cookie.split(";")}
        assert answer.headers["referrer-policy"] == "no-referrer"


# -- what it accepts


def test_only_pictures_of_its_folders_can_be_read(served: Served) -> None:
    secret = served.folder.parent / "secret.png"
    secret.write_bytes(png(exemplar()))
    (served.folder / "link.png").symlink_to(secret)
    for picture in ("folder:../secret.png", "folder:link.png", f"folder:{secret}", str(secret), "folder:", "x:y"):
        assert served.request(f"/api/pictures?id={picture}")[0] == 422, picture
        recipe = {**RECIPE, "sources": {"exemplar": picture}}
        assert served.request("/api/jobs", recipe)[0] == 422, picture
    (served.folder / "link.png").unlink()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"flow": "os"}, "no such flow"),
        ({"flow": "../x"}, "no such flow"),
        ({"size": "1x1"}, "greater than or equal to 2"),
        ({"size": "99999x4"}, "less than or equal"),
        ({"params": {"texture.blok": 3}}, "did you mean"),
        ({"params": {"surface.geometry": "/etc/passwd"}}, "params"),
        ({"code": "print()"}, "code"),
        ({"sources": {"nothing": "texloom:bricks"}}, "nothing"),
    ],
    ids=str,
)
def test_wrong_recipes_are_refused_in_one_line(served: Served, change: dict[str, Any], said: str) -> None:
    status, answer = served.request("/api/described", {**RECIPE, **change})
    assert status == 422
    problem = json.loads(answer)["problem"]
    assert said in problem
    assert "\n" not in problem


def test_broken_files_are_refused_and_removed(served: Served) -> None:
    whole = png(exemplar())
    for name, content in {"cut.png": whole[:-200], "text.png": b"hello", "empty.png": b""}.items():
        status, answer = served.upload({name: content})
        assert status == 422, name
        assert name in answer["problem"]
        assert "/" not in answer["problem"]
    assert not list((served.store / "sources").glob(".new-*"))
    status, picture = served.upload({"whole.png": whole})
    assert (status, picture["name"], picture["is_material"]) == (200, "whole", False)


def test_a_dropped_folder_is_a_material(served: Served) -> None:
    maps = {"moss_albedo.png": png(exemplar()), "moss_height.png": png(exemplar()[..., 0])}
    status, picture = served.upload(maps, "moss")
    assert (status, picture["name"], picture["is_material"]) == (200, "moss", True)
    assert picture in served.json("/api/start")["listed"]["pictures"]


@pytest.mark.parametrize(
    ("header", "value", "status"),
    [("Content-Length", str(2**20 + 1), 413), ("Transfer-Encoding", "chunked", 411)],
)
def test_requests_that_are_large_or_of_unknown_length_are_refused(
    served: Served, header: str, value: str, status: int
) -> None:
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", served.port, timeout=30)) as connection:
        connection.putrequest("POST", "/api/described")
        connection.putheader("Cookie", served.cookie)
        connection.putheader(header, value)
        connection.endheaders()
        assert connection.getresponse().status == status


@pytest.mark.parametrize(
    "frame", [b"", numbered(1, 0), numbered(1, 0, b"\xff\xff\xff\xff{}"), numbered(1, 0, b"\x02\0\0\0{}")]
)
def test_nonsense_on_the_socket_closes_it(served: Served, frame: bytes) -> None:
    with connected(served) as page:
        page.socket.send(frame)
        with pytest.raises(websockets.ConnectionClosed):
            list(page.messages())


def test_only_results_can_be_read(served: Served) -> None:
    finished(served, RECIPE)
    run = served.json("/api/runs")["runs"][0]
    step = next(one for one in served.json(f"/api/runs/{run['id']}") if one["name"] == "texture")
    assert served.request(f"/api/results/{step['key']}/image.png")[1].startswith(b"\x89PNG")
    for address in (
        f"/api/results/{step['key']}/manifest.json",
        f"/api/results/{step['key']}/..%2Fimage.png",
        "/api/results/*/image.png",
        "/api/runs/none",
        "/api/layers?item=result:*",
        "/api/layers?item=folder:../secret.exr",
        "/api/layers?item=job:none:texture.exr",
        "/api/layers/..%2F../x",
    ):
        assert served.request(address)[0] in (404, 422), address


# -- what it makes


def test_runs_are_those_of_the_command_line(served: Served, tmp_path: Path) -> None:
    """Of the flow file and of the command, in a store of their own: every export has the same bytes."""
    recipe = {**RECIPE, "params": {"texture.block": 12}}
    described = served.json("/api/described", recipe)
    job = finished(served, recipe)
    assert job["state"] == "done", job["text"]
    file = tmp_path / described["file"]
    file.write_text(described["yaml"])
    assert "texture.png" in job["files"]
    command = shlex.split(described["command"])
    assert command[:2] == ["texloom", "run"]
    for arguments in ([str(file)], command[2:]):
        out = run_again(arguments, tmp_path)
        for name in job["files"]:
            assert served.request(f"/api/jobs/{job['id']}/files/{name}")[1] == (out / name).read_bytes(), name
    assert {step["state"] for step in served.json("/api/described", recipe)["steps"]} == {"cached"}


def test_a_run_is_saved_where_the_command_line_writes(served: Served) -> None:
    job = finished(served, RECIPE)
    folder = served.folder / "blotches_quilting"
    address = f"/api/jobs/{job['id']}/saved"
    try:
        folder.mkdir()
        (folder / "texture.png").write_bytes(b"mine")
        status, answer = served.request(address, method="POST")
        problem = "texture.png was not written by texloom, or was changed since; move it away"
        assert status == 422
        assert problem in json.loads(answer)["problem"]
        assert [path.name for path in folder.iterdir()] == ["texture.png"]
        (folder / "texture.png").unlink()
        for _ in range(2):
            status, answer = served.request(address, method="POST")
            assert (status, json.loads(answer)["saved"]) == (200, str(folder))
        for name in job["files"]:
            content = served.request(f"/api/jobs/{job['id']}/files/{name}")[1]
            assert (folder / name).read_bytes() == content, name
        assert served.request("/api/jobs/none/saved", method="POST")[0] == 404
    finally:
        shutil.rmtree(folder)


def test_previews_follow_and_the_last_one_wins(served: Served) -> None:
    with connected(served) as page:
        for number in (1, 2, 3):
            preview(page, number, {**RECIPE, "seed": number})
        for message, payload in page.messages():
            if message["kind"] == "preview_picture":
                assert len(payload) == 4 * message["height"] * message["width"]
                if message["number"] == 3 and message["is_final"]:
                    break
    assert (message["height"], message["width"], message["scale"]) == (48, 64, 1.0)


def test_work_that_follows_what_was_cancelled_may_take_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only what does not heed its cancellation is killed."""
    monkeypatch.setattr(processes, "_PATIENCE", 0.5)
    places = Places(folder=str(tmp_path), store=str(tmp_path / "store"), scratch=str(tmp_path / "scratch"))
    recipe = Recipe(flow="self_tuning", sources={"exemplar": "texloom:bricks"}, size=(512, 512))

    async def work() -> int:
        worker = processes.WorkerProcess(places)
        try:
            first = asyncio.create_task(worker.answer(PreviewRequest(number=1, recipe=recipe)))
            await asyncio.sleep(0)
            worker.cancel()
            frames = 0
            with contextlib.suppress(processes.WorkCancelledError, InputError):
                await first
            async for _ in worker.frames(PreviewRequest(number=2, recipe=recipe)):
                frames += 1
            return frames
        finally:
            worker.kill()

    with ThreadPoolExecutor(1) as pool:  # a browser of another test has a loop in this thread
        assert pool.submit(asyncio.run, work()).result() > 0


def test_work_may_follow_what_was_killed_as_it_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The next piece of work is not given to the process that is being killed."""
    monkeypatch.setattr(processes, "_PATIENCE", 0.1)
    places = Places(folder=str(tmp_path), store=str(tmp_path / "store"), scratch=str(tmp_path / "scratch"))
    picture = PictureWork(picture="texloom:bricks", side=16)

    async def work() -> None:
        worker = processes.WorkerProcess(places)
        try:
            for _ in range(3):
                await worker.answer(picture)
                first = asyncio.create_task(worker.answer(picture))
                await asyncio.sleep(0)
                worker.cancel()
                time.sleep(0.3)  # the loop finds the end of the work and the end of its patience at the same time
                with contextlib.suppress(processes.WorkCancelledError, InputError):
                    await first
        finally:
            worker.kill()

    with ThreadPoolExecutor(1) as pool:  # a browser of another test has a loop in this thread
        pool.submit(asyncio.run, work()).result()


def test_the_next_worker_is_ready_before_it_is_needed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "PAUSE", 0.0)
    places = Places(folder=str(tmp_path), store=str(tmp_path / "store"), scratch=str(tmp_path / "scratch"))

    async def work() -> list[bool]:
        spares = processes.Spares(places, PictureWork(picture="texloom:bricks", side=16))
        spares.prepare()
        taken = []
        try:
            for _ in range(3):
                await asyncio.sleep(0.2)
                taken.append(spares.take())
            return [worker.is_alive for worker in taken]
        finally:
            for worker in taken:
                worker.kill()
            await spares.end()

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(asyncio.run, work()).result() == [True] * 3


def test_maps_are_written_for_a_program(served: Served) -> None:
    recipe = {**RECIPE, "layout": "unreal"}
    told = served.json("/api/described", recipe)
    assert yaml.safe_load(told["yaml"])["delivery"] == {"layout": "unreal"}
    assert "--layout unreal" in told["command"]
    job = finished(served, recipe)
    content = served.request(f"/api/jobs/{job['id']}/files/maps/")[1]
    assert any(name.endswith("_BC.png") for name in zipfile.ZipFile(io.BytesIO(content)).namelist())
    assert served.request("/api/jobs", {**RECIPE, "layout": "none"})[0] == 422


def test_a_failing_preview_says_why(served: Served) -> None:
    with connected(served) as page:
        preview(page, 1, {**RECIPE, "params": {"texture.block": 4000}})
        told = next(message for message, _ in page.messages() if message["kind"] == "preview_failed")
    assert "block" in told["problem"]


def test_the_server_survives_workers_that_are_killed(served: Served) -> None:
    finished(served, {**RECIPE, "seed": 11})
    workers = _workers(served.process.pid)
    assert len(workers) > 1
    for pid in workers:
        os.kill(pid, signal.SIGKILL)
    assert finished(served, {**RECIPE, "seed": 12})["state"] in ("done", "failed")
    assert finished(served, {**RECIPE, "seed": 13})["state"] == "done"


class _Sent:
    """A connection that keeps what is sent."""

    def __init__(self) -> None:
        self.frames: list[bytes] = []

    def send_bytes(self, frame: bytes) -> None:
        self.frames.append(frame)


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), RuntimeError("x.exr: No space left on device.")]
)
def test_a_full_disk_is_told_and_can_be_freed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise error

    places = Places(folder=str(tmp_path), store=str(tmp_path / "store"), scratch=str(tmp_path / "scratch"))
    PIL.Image.fromarray(exemplar()).save(tmp_path / "blotches.png")
    worker = WorkLoop(_Sent(), places)  # type: ignore[arg-type]
    request = packed(RunWork(recipe=Recipe.model_validate(RECIPE)))
    with monkeypatch.context() as patch:
        patch.setattr(codec, "write", fail)
        assert "the disk is full; free some space" in worker.ended(request).problem
    assert not list((tmp_path / "store").rglob(".new-*"))
    assert worker.ended(request).problem == ""


def _workers(pid: int) -> list[int]:
    """The workers of a server, which the process that has imported for all of them may have started."""
    found = []
    for child in map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split()):
        command = Path(f"/proc/{child}/cmdline").read_text()
        if "spawn_main" in command:
            found.append(child)
        elif "forkserver" in command:
            found += map(int, Path(f"/proc/{child}/task/{child}/children").read_text().split())
    return found


def test_a_waiting_run_can_be_cancelled(served: Served) -> None:
    recipe = {**RECIPE, "flow": "self_tuning", "size": "512x512"}
    first, second = (served.json("/api/jobs", {**recipe, "seed": seed}) for seed in (1, 2))
    for job in (second, first):
        served.json(f"/api/jobs/{job['id']}", method="DELETE")
    assert finished(served, {**RECIPE, "seed": 14})["state"] == "done"
    assert served.request("/api/jobs/none", method="DELETE")[0] == 404


def test_what_was_cancelled_can_be_tried_again_under_its_name(served: Served) -> None:
    served.json("/api/jobs", {**RECIPE, "flow": "self_tuning", "size": "256x256"})
    job = served.json("/api/jobs", {**RECIPE, "seed": 15})  # waits for the other one
    served.json(f"/api/jobs/{job['id']}", method="DELETE")
    assert served.json(f"/api/jobs/{job['id']}/again", b"", "POST")["state"] == "waiting"
    with connected(served) as page:
        states = (message["job"] for message, _ in page.messages() if message["kind"] == "job_changed")
        assert next(told for told in states if told["id"] == job["id"] and told["state"] == "done")["files"]
    assert served.json(f"/api/jobs/{job['id']}/again", b"", "POST")["state"] == "done"
    assert served.request("/api/jobs/none/again", b"", "POST")[0] == 404


def test_the_page_is_sent_compressed(served: Served) -> None:
    plain = served.request("/studio.js")[1]
    packed_page = served.request("/studio.js", accept_encoding="gzip")[1]
    assert gzip.decompress(packed_page) == plain
    assert len(packed_page) < 0.5 * len(plain)
