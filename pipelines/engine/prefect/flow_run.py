"""A run as a flow run of a Prefect server, with a task run for each step."""

from __future__ import annotations

import contextlib
import contextvars
import dataclasses
import glob
import inspect
import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import httpx
import prefect
from prefect.logging.handlers import PrefectConsoleHandler
from prefect.settings import (
    PREFECT_API_REQUEST_TIMEOUT,
    PREFECT_API_URL,
    PREFECT_CLIENT_MAX_RETRIES,
    PREFECT_FLOWS_HEARTBEAT_FREQUENCY,
    temporary_settings,
)

from texloom.pipelines.engine import signals
from texloom.pipelines.engine.attempt import compute
from texloom.pipelines.engine.destination import placed
from texloom.pipelines.engine.events import Event, ItemReport, Listener, Note, Recorder, summary_of
from texloom.pipelines.engine.opening import open_request, open_store
from texloom.pipelines.engine.prefect.scores import show_scores
from texloom.pipelines.engine.prefect.task_runs import TaskRuns
from texloom.pipelines.engine.preflight import Preflight
from texloom.pipelines.engine.run import Run
from texloom.pipelines.flow.comparison import comparison_flow
from texloom.pipelines.flow.model import Each, Flow, Overrides
from texloom.pipelines.flow.source_files import is_pattern
from texloom.pipelines.flow.step_params import document_params
from texloom.pipelines.request import RunRequest, request
from texloom.pipelines.request_fields import OPTIONS
from texloom.pipelines.yaml import parse_yaml
from texloom.stages.vocabulary.declare import InputError

_SETTINGS: dict[Any, Any] = {
    PREFECT_FLOWS_HEARTBEAT_FREQUENCY: None,  # each flow would wait for it at exit
    # with Prefect's own a server that stalls would hold a run that is done for six minutes
    PREFECT_API_REQUEST_TIMEOUT: 10.0,
    PREFECT_CLIENT_MAX_RETRIES: 2,
}


class ItemsFailedError(RuntimeError):
    """Items of a set have failed; the others are done."""


@dataclasses.dataclass
class _Opened:
    """A run that this process has opened, for the flow run that it starts."""

    run: Run
    folder: Path
    """of its exports"""
    listener: Listener
    exports: dict[str, Path] = dataclasses.field(default_factory=dict)
    problem: BaseException | None = None
    """what has ended the run"""
    has_ended: bool = False


_opened: contextvars.ContextVar[_Opened | None] = contextvars.ContextVar("opened", default=None)


def execute_as_flow_run(run: Run, listener: Listener, out: Path) -> dict[str, Path]:
    """As `texloom.pipelines.engine.scheduler.execute`, as a flow run under the flow's own name."""
    _require_server()
    _silence_console()
    opened = _Opened(run, out, listener)
    token = _opened.set(opened)
    try:
        with signals.deferred(), temporary_settings(_SETTINGS), contextlib.suppress(ItemsFailedError):
            texloom_flow.with_options(name=run.flow.name)(**parameters_of(run, out))
    except httpx.HTTPError as error:
        if not opened.has_ended:
            raise InputError(_silent_server(error)) from None
        listener(Note("the Prefect server does not answer: it does not know that the run has ended"))
        if opened.problem is not None:
            raise opened.problem from None
    finally:
        _opened.reset(token)
    return opened.exports


def parameters_of(run: Run, out: Path) -> dict[str, Any]:
    """The parameters of `texloom_flow` that repeat a run, whatever the working folder."""
    sources = {
        name: _given(given)
        for name, given in run.flow.sources.items()
        # a file whose name looks like a pattern can be given only in the flow file
        if isinstance(given, Each) or not glob.has_magic(given)
    }
    methods = [*map(str, run.flow.compared), *(f"{name}={folder}" for name, folder in run.flow.against.items())]
    return {
        "flow": methods or str(run.flow.path.resolve()),
        "source": sources,
        "set": {target: _param(run.flow, target, value) for target, value in _values(run.flow.overrides).items()},
        "export": dict(run.flow.overrides.exports),
        "seeds": list(run.flow.seeds),
        "item": run.flow.item,
        "keep": "final" if run.flow.intermediate else None,
        "store": str(run.store.root),
        "remote": run.store.remote or None,
        "out": str((out / (run.flow.picture or "")).absolute()),
        "runner": run.flow.runner.name,
        "workers": run.flow.runner.workers,
        "address": run.flow.runner.address,
        **run.flow.overrides.part,
        **run.flow.overrides.delivery,
    }


def _given(source: str | Each) -> str | list[str]:
    """A source as ``--source`` takes it; a set that is no single pattern is a list."""
    if isinstance(source, str):
        return source
    first, *others = source.patterns
    return list(source.patterns) if others or not is_pattern(first) else first


def _values(overrides: Overrides) -> dict[str, Any]:
    return {target: parse_yaml(text, f"--set {target}") for target, text in overrides.texts.items()}


def _param(flow: Flow, target: str, value: Any) -> Any:
    """A value of ``--set``, with absolute paths."""
    step, _, param = flow.params.get(target, (target,))[0].partition(".")
    if step not in flow.steps or param not in type(flow.steps[step].params).model_fields:
        return value
    params = flow.steps[step].params
    if param in document_params(type(params)) and getattr(params, param) is not None:
        return str(getattr(params, param).file)
    return params.model_dump(mode="json")[param]


def _run_name() -> str:
    """What a flow run is called: its flow, sources and seeds."""
    given, opened = prefect.runtime.flow_run.parameters, _opened.get()
    flows = given["flow"] if isinstance(given["flow"], list) else [given["flow"]]
    words = [" and ".join(Path(flow).stem for flow in flows) if opened is None else opened.run.flow.name]
    words += [_set_name(source) for source in (given["source"] or {}).values()]
    seeds = given["seeds"] if isinstance(given["seeds"], list | tuple) else [given["seed"]] * (given["seeds"] or 1)
    if seeds != [None]:
        words.append(f"seed {seeds[0]}" if len(seeds) == 1 else f"{len(seeds)} seeds")
    return ", ".join(words)


def _set_name(source: str | list[str]) -> str:
    return Path(source).name if isinstance(source, str) else f"{len(source)} pictures"


def run_flow(flow: str | list[str], **given: Any) -> dict[str, str]:
    """Run a flow file, every step a task.

    The parameters are the options of ``texloom run``; several flows are compared, as by ``texloom compare``.
    """
    opened = _opened.get()
    if opened is None:
        asked = request(flow=flow if isinstance(flow, str) else "comparison", **_fields(given))
        if isinstance(flow, str):
            run, folder = open_request(asked)
        else:
            compared = Run(comparison_flow(flow, asked.overrides), open_store(asked))
            run, folder = placed(compared, asked.out)
        Preflight(run).check(folder, asked.force)
        opened = _Opened(run, folder, _ignore)
    run, folder, listener = opened.run, opened.folder, opened.listener
    listener(Note(f"flow run {prefect.runtime.flow_run.name}: {prefect.runtime.flow_run.ui_url}"))

    run.shows_scales = True
    with TaskRuns(run, listener) as task_runs:

        def show(event: Event) -> None:
            listener(event)
            with signals.deferred():
                task_runs(event)
                if isinstance(event, Note):
                    prefect.get_run_logger().warning(event.text)
                elif isinstance(event, ItemReport) and event.problem is not None:
                    prefect.get_run_logger().error(f"{event.item} failed: {event.problem}")

        recorder = Recorder(show)
        try:
            with signals.accepted():
                opened.exports = compute(run, recorder, folder)
        except BaseException as error:
            opened.problem = error
            raise
        finally:
            opened.has_ended = True
    with contextlib.suppress(httpx.HTTPError):
        show_scores(run)
    if recorder.problems:
        raise ItemsFailedError(summary_of(recorder.problems, len(run.items)))
    return {name: str(path) for name, path in opened.exports.items()}


_NAMES = {field: option.flags[0].strip("-") for field, option in OPTIONS.items() if option.flags}
"""of the parameters that are called as the option, not as the field"""
_KINDS: dict[str, Any] = {"set": dict[str, Any], "size": int | str | None, "store": str | None, "out": str | None}
"""of those that are not JSON, or may be more of it"""


def _signature() -> inspect.Signature:
    """The parameters of a flow run: the fields of `RunRequest`, but for pictures, which sources name."""
    parameters = [inspect.Parameter("flow", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=str | list[str])]
    for field in OPTIONS:
        if field not in ("flow", "pictures"):
            name, known = _NAMES.get(field, field), RunRequest.model_fields[field]
            kind = _KINDS.get(name, known.annotation)
            parameters.append(
                inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=known.default, annotation=kind)
            )
    return inspect.Signature(parameters, return_annotation=dict[str, str])


def _fields(given: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a request by the parameters of a flow run, whose values are JSON."""
    named = {field: given.get(_NAMES.get(field, field)) for field in OPTIONS}
    fields = {field: value for field, value in named.items() if value not in (None, "")}  # "": of an empty form
    if "size" in fields:
        fields["size"] = str(fields["size"])
    return fields | {"params": {target: json.dumps(value) for target, value in fields.get("params", {}).items()}}


run_flow.__signature__ = _signature()  # type: ignore[attr-defined]
texloom_flow = prefect.flow(
    name="texloom", flow_run_name=_run_name, validate_parameters=True, persist_result=False
)(run_flow)


def _ignore(_: Event) -> None:
    """Nobody is at the terminal."""


def _silence_console() -> None:
    """Remove Prefect's handler of log lines from the terminal."""
    for handler in list(logging.getLogger().handlers):
        if isinstance(handler, PrefectConsoleHandler):
            logging.getLogger().removeHandler(handler)


def _require_server() -> None:
    try:
        httpx.get(f"{str(PREFECT_API_URL.value()).rstrip('/')}/health", timeout=5).raise_for_status()
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        raise InputError(_silent_server(error)) from None


def _silent_server(error: Exception) -> str:
    reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    where = f"PREFECT_API_URL={PREFECT_API_URL.value()}"
    return f"no Prefect server answers at {where} ({reason}); start one, or unset PREFECT_API_URL"
