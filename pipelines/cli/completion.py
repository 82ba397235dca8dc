"""Completion in shells: flows, steps, params, sources and their values.

Click's scripts are not enough: a word such as ``PARAM=VALUE`` needs no space after ``=``, and files after it.
"""

from __future__ import annotations

import os
import typing
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import (
    BashComplete,
    CompletionItem,
    FishComplete,
    ZshComplete,
    add_completion_class,
    get_completion_class,
)
from click.shell_completion import split_arg_string as words_of

if TYPE_CHECKING:
    from texloom.pipelines.flow.model import Flow
    from texloom.stages.vocabulary.declare import Params

_VARIABLE = "_TEXLOOM_COMPLETE"

Items = list[CompletionItem[str]]


def script(shell: str) -> str:
    """What a shell reads to complete texloom's words."""
    register()
    found = get_completion_class(shell)
    if found is None:
        raise click.UsageError(f"no completion for {shell}")
    from texloom.pipelines.cli.main import texloom

    return found(texloom, {}, "texloom", _VARIABLE).source()


class _Bash(BashComplete):
    """Completes words with ``=`` and ``:``, at which bash parts words, and adds no space after ``=``."""

    source_template = """\
%(complete_func)s() {
    local IFS=$'\\n' response item type value
    response=$(env COMP_WORDS="${COMP_LINE:0:COMP_POINT}" %(complete_var)s=bash_complete $1)
    for item in $response; do
        IFS=',' read type value <<< "$item"
        if [[ $type == 'dir' ]]; then
            compopt -o dirnames
        elif [[ $type == 'file' ]]; then
            compopt -o default
        else
            COMPREPLY+=("$value")
            [[ $value == *= ]] && compopt -o nospace
        fi
    done
    return 0
}
complete -o nosort -F %(complete_func)s %(prog_name)s
"""

    def get_completion_args(self) -> tuple[list[str], str]:
        line = os.environ["COMP_WORDS"]
        words = words_of(line)[1:]
        return (words, "") if line[-1:].isspace() or not words else (words[:-1], words[-1])

    def format_completion(self, item: CompletionItem[Any]) -> str:
        _, typed = self.get_completion_args()
        kept = max(typed.rfind(mark) for mark in "=:") + 1  # bash adds to what follows the mark
        return f"{item.type},{item.value[kept:] if item.type == 'plain' else item.value}"


class _Zsh(ZshComplete):
    """Adds no space after ``=``, and completes files after it; loads zsh's completion where nobody has."""

    source_template = """\
#compdef %(prog_name)s
(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }

%(complete_func)s() {
    local -a plain described unfinished response
    local type key descr
    local -x COMP_WORDS="${words[*]}" COMP_CWORD=$((CURRENT-1)) %(complete_var)s=zsh_complete
    response=("${(@f)$($words[1])}")
    for type key descr in ${response}; do
        case $type in
            dir) compset -P '*='; _path_files -/ ;;
            file) compset -P '*='; _path_files -f ;;
            *)
                if [[ $key == *= ]]; then unfinished+=("$key")
                elif [[ $descr == _ ]]; then plain+=("$key")
                else described+=("$key:$descr")
                fi ;;
        esac
    done
    (( $#described )) && _describe -V unsorted described -U
    (( $#plain )) && compadd -U -V unsorted -a plain
    (( $#unfinished )) && compadd -U -V unsorted -S '' -a unfinished
}

if [[ $zsh_eval_context[-1] == loadautofunc ]]; then
    %(complete_func)s "$@"
else
    compdef %(complete_func)s %(prog_name)s
fi
"""


class _Fish(FishComplete):
    """Completes files after ``=``."""

    source_template = """\
function %(complete_func)s
    set -l words (commandline -cp)
    set -l word (commandline -ct)
    set -l before (string match -r '^.*=' -- $word)
    for item in (env %(complete_var)s=fish_complete COMP_WORDS="$words" COMP_CWORD="$word" %(prog_name)s)
        set -l parts (string split -m 1 ',' -- $item)
        switch $parts[1]
            case dir
                __fish_complete_directories $parts[2]
            case file
                for path in (__fish_complete_path $parts[2])
                    echo "$before$path"
                end
            case plain
                echo $parts[2]
        end
    end
end

complete --no-files --command %(prog_name)s --arguments '(%(complete_func)s)'
"""


def register() -> None:
    """Let shells complete in these ways."""
    for kind in (_Bash, _Zsh, _Fish):
        add_completion_class(kind)


def flow_names(_context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """Flows that ship, those that are listed before anything is typed, and files."""
    from texloom.pipelines.flow.shipped import flow_catalogue

    entries = {name: entry for name, entry in flow_catalogue().items() if typed or entry.listed}
    found = [CompletionItem(name, help=one.about) for name, one in entries.items() if name.startswith(typed)]
    return found or [CompletionItem(typed, type="file")]


def stage_names(_context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """Stages by their short names, or with their groups."""
    from texloom.stages.lookup.registry import stage_names

    return _plain([name if "." in typed else name.rpartition(".")[2] for name in stage_names()], typed)


def pictures(_context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """Files, or what ships as texloom:NAME."""
    return _pictures("", typed)


def paths(_context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """Files and folders, also after ``NAME=``."""
    return [CompletionItem(typed.rpartition("=")[2], type="file")]


def params(context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """``PARAM=`` of a flow and its steps; after the sign, the values of a choice, or files."""
    flow = _flow(context)
    if flow is None:
        return []
    name, equals, path = typed.partition("=")
    if equals and _takes_file(flow, name):
        return [CompletionItem(path, type="file")]
    if equals:
        return _plain([f"{name}={value}" for value in _choices(flow, name)], typed)
    of_steps = [f"{step.name}.{param}" for step in flow.steps.values() for param in type(step.params).model_fields]
    return _plain([f"{param}=" for param in [*flow.params, *of_steps]], typed)


def presets(context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """Values of a flow's preset."""
    flow = _flow(context)
    return [] if flow is None else _plain(_choices(flow, "preset"), typed)


def sources(context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """``NAME=`` of a flow's sources; after the sign, pictures."""
    flow = _flow(context)
    name, equals, path = typed.partition("=")
    if equals:
        return _pictures(f"{name}=", path)
    return [] if flow is None else _plain([f"{name}=" for name in [*flow.sources, *flow.left_out]], typed)


def exports(context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """After ``NAME.EXT=``, the outputs of a flow's steps."""
    flow = _flow(context)
    name, equals, _ = typed.partition("=")
    if flow is None or not equals:
        return []
    outputs = [f"{name}={step.name}.{output}" for step in flow.steps.values() for output in step.stage.outputs]
    return _plain(outputs, typed)


def layouts(_context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """The layouts of material sets."""
    from texloom.pipelines.media.delivery import LAYOUTS

    return _plain(list(LAYOUTS), typed)


def color_spaces(_context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """The colour spaces of EXR and tx."""
    from texloom.pipelines.media.delivery import COLOR_SPACES

    return _plain(list(COLOR_SPACES), typed)


def runners(_context: click.Context, _parameter: click.Parameter, typed: str) -> Items:
    """The runners."""
    from texloom.pipelines.flow.model import RUNNERS

    return [CompletionItem(name, help=text) for name, text in RUNNERS.items() if name.startswith(typed)]


def _plain(values: Iterable[str], typed: str) -> Items:
    return [CompletionItem(value) for value in values if value.startswith(typed)]


def _pictures(before: str, typed: str) -> Items:
    from texloom.pipelines.media.locate import shipped_pictures

    if ":" in typed or (typed and any(name.startswith(typed) for name in shipped_pictures())):
        return _plain([f"{before}{name}" for name in shipped_pictures()], before + typed)
    return [CompletionItem(typed, type="file")]


def _flow(context: click.Context) -> Flow | None:
    """The flow that has been typed, unless it is wrong."""
    from texloom.pipelines.flow.loader import find_flow, load_flow
    from texloom.stages.vocabulary.declare import InputError

    # click leaves the arguments unread where an option before them still lacks its value
    given = context.params.get("flow"), *context.params.get("flows", ()), *context.args
    name = next((word for word in given if word and not word.startswith("-")), None)
    try:
        return load_flow(find_flow(name)) if name else None
    except InputError:
        return None


def _param(flow: Flow, name: str) -> tuple[type[Params], str] | None:
    """The model that holds a param of a flow or of its steps, and the param's name there."""
    step, _, param = flow.params.get(name, (name,))[0].partition(".")
    model = type(flow.steps[step].params) if step in flow.steps else None
    return (model, param) if model is not None and param in model.model_fields else None


def _takes_file(flow: Flow, name: str) -> bool:
    """Whether a param names a file."""
    from texloom.pipelines.flow.step_params import document_params, file_params

    found = _param(flow, name)
    return found is not None and found[1] in document_params(found[0]) + file_params(found[0])


def _choices(flow: Flow, name: str) -> list[str]:
    """The values of a param of few."""
    from texloom.stages.vocabulary.facts import Wraps
    from texloom.stages.vocabulary.tileable import NAMES

    found = _param(flow, name)
    if found is None:
        return []
    kind = found[0].model_fields[found[1]].annotation
    parts = typing.get_args(kind)
    kinds = [kind, *parts, *(part for one in parts for part in typing.get_args(one))]
    if Wraps in kinds:
        return list(NAMES)
    if bool in kinds:
        return ["true", "false"]
    return [
        str(value) for one in kinds if typing.get_origin(one) is typing.Literal for value in typing.get_args(one)
    ]
