"""The command ``texloom``. Heavy libraries are imported by the commands that need them, so that help is instant."""

from __future__ import annotations

import gc
import os
import signal
import sys
from pathlib import Path
from typing import Any

import click

from texloom.pipelines.cli.catalogue_commands import check_stage, flows, stages
from texloom.pipelines.cli.compare_command import compare
from texloom.pipelines.cli.exits import ENDING_SIGNALS, Exit, end_in_order, ended_by
from texloom.pipelines.cli.options import json_option, memory_option, store_option
from texloom.pipelines.cli.output import complain, print_json, text_stream
from texloom.pipelines.cli.run_commands import WhichFlowError, commands, plan, run
from texloom.pipelines.cli.show import show
from texloom.pipelines.cli.store_commands import store
from texloom.pipelines.interruption_cause import interruption_of

_WHICH_FLOW = """\
texloom: which flow? For a larger texture of one picture:

    texloom run self_tuning mine.png --size 1024 --tileable --out mine

    self_tuning        a larger texture of one exemplar, of the best quality
    quilting           the same in a second or two
    materials          the same for a folder of maps: albedo, normal, roughness, height
    make_tileable      a picture that tiles; only its borders change
    fill               holes of a picture filled from the rest of it
    photo_to_texture   a flat texture from a surface in a photograph

Without a picture, a flow uses an example that ships. `texloom flows` lists all flows."""


class _Commands(click.Group):
    """Commands, with a hint where a flow stands for one."""

    def resolve_command(self, context: click.Context, args: list[str]) -> Any:
        try:
            return super().resolve_command(context, args)
        except click.UsageError as error:
            from texloom.pipelines.flow.shipped import shipped_flows

            if args[0] not in shipped_flows():
                if getattr(error, "possibilities", None):  # which click names
                    raise
                raise click.UsageError(f"{error.message} See texloom --help.", context) from None
            raise click.UsageError(f"{args[0]} is a flow: texloom run {args[0]}", context) from None


def main() -> None:
    """Run the command line and exit.

    0: done, 1: a stage failed, 2: the request is wrong, 130: interrupted, 143: terminated.
    """
    gc.set_threshold(100_000, 20, 20)  # collecting the many objects of imports takes a tenth of a plan
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # the search for plug-ins takes as long
    os.environ.setdefault("PYTHONSAFEPATH", "1")  # or worker processes would import modules of the working folder
    before = {number: signal.getsignal(number) for number in ENDING_SIGNALS}
    for number, handler in before.items():
        if handler != signal.SIG_IGN:  # as in a shell's background, where Ctrl-C is not for this process
            signal.signal(number, end_in_order)
    if os.environ.get("_TEXLOOM_COMPLETE"):
        from texloom.pipelines.cli.completion import register

        register()
    try:
        code = _exit_code()
    finally:
        for number, handler in before.items():
            if signal.getsignal(number) == end_in_order:  # nothing has ended the run
                signal.signal(number, handler)
    if "OpenImageIO" not in sys.modules:  # which complains about what is not collected
        gc.freeze()  # to look through all that a run has loaded once more would take a quarter of a second
    sys.exit(code)


def _exit_code() -> int:
    """Run the command, and tell in a line what has gone wrong."""
    try:
        return texloom.main(prog_name="texloom", standalone_mode=False) or Exit.DONE
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.ctx.get_help() if error.ctx else "")
        return Exit.WRONG
    except WhichFlowError:
        click.echo(_WHICH_FLOW, err=True)
        return Exit.WRONG
    except click.ClickException as error:
        command = error.ctx.command_path if isinstance(error, click.UsageError) and error.ctx else "texloom"
        complain(f"{command}: {error.format_message()}{_hint_at_file(error)}")
        return Exit.WRONG
    except ValueError as error:
        from texloom.stages.vocabulary.declare import InputError  # not at the top, as help does not need it

        if not isinstance(error, InputError):
            raise
        complain(f"texloom: {error}")
        return Exit.WRONG
    except (KeyboardInterrupt, RuntimeError, ImportError, SystemError) as error:
        if interruption_of(error) is None and not isinstance(error, click.Abort):
            raise
        ended, code = ended_by(error)
        click.echo(f"texloom: {ended}", err=True)  # without imports: one of them may have been interrupted
        return code
    except OSError as error:  # a full disk, a folder that has gone; click leaves quietly when a pipe is closed
        named = error.errno is None or error.filename is not None  # as all that is written by name
        complain(f"texloom: {'' if named else 'standard output: '}{error if named else error.strerror}")
        if not named:  # Python would try once more at its end, and complain
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return Exit.FAILED


def _hint_at_file(error: click.ClickException) -> str:
    """How to name a file that was taken for an option, as its name begins with a dash."""
    if not isinstance(error, click.NoSuchOption):
        return ""
    alike = (word for word in sys.argv[1:] if word.startswith(error.option_name))
    name = next((word for word in alike if os.path.lexists(word)), None)
    return "" if name is None else f" For a file, write ./{name}"


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="texloom")
def texloom() -> None:
    """Make new textures from example textures; compute nothing twice.

    \b
    texloom flows                                        what it can make, and from what
    texloom run self_tuning                              the main method on an exemplar that ships
    texloom run self_tuning mine.png --size 1536x1024 --tileable --out mine
    texloom plan self_tuning mine.png --preset fast      what that would compute again, and why
    """


@texloom.command(short_help="Make textures in the browser, on this machine alone.")
@click.argument("folder", default=".", type=click.Path(path_type=Path))
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Of the address.  [default: a free one]")
@click.option("--no-browser", is_flag=True, help="Print an address and open no browser.")
@memory_option
@store_option
def studio(folder: Path, port: int, no_browser: bool, store_folder: Path) -> int:
    """Serve a page to make textures of the pictures of FOLDER, by default the working folder.

    \b
    texloom studio
    texloom studio library --no-browser --port 8000

    The address that is printed opens the page in one browser, once; then another one is printed. Nothing leaves
    this machine. Whatever is made there can be shown as a flow file or as a command. Ctrl-C ends the studio.
    """
    from texloom.pipelines.studio.launch import launch

    launch(folder, store_folder, port, browser=not no_browser)
    return Exit.DONE


@texloom.command(short_help="Serve other programs, as Blender or ComfyUI, on this machine alone.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Of the address.  [default: a free one]")
@click.option("--attached", is_flag=True, help="End when standard input ends, as with the program that holds it.")
@memory_option
@store_option
def serve(port: int, attached: bool, store_folder: Path) -> int:
    """Make textures for other programs, which send pictures and get pictures back.

    \b
    texloom serve
    texloom client > texloom_client.py     what such a program needs: one file, which starts this by itself

    The line that is printed, in JSON, has the address and the token without which nothing is answered. Nothing
    leaves this machine. Ctrl-C ends the server.
    """
    from texloom.pipelines.studio.launch import serve as serve_hosts

    serve_hosts(store_folder, port, attached)
    return Exit.DONE


@texloom.command(short_help="Print the Python file by which other programs use texloom.")
def client() -> int:
    """Print a Python file without dependencies, for Python 3.9 and later, by which programs use ``texloom serve``.

    \b
    texloom client > texloom_client.py
    """
    from texloom.pipelines.bridge import client as file

    click.echo(Path(file.__file__).read_text(encoding="utf-8"), nl=False)
    return Exit.DONE


@texloom.command(short_help="Print what texloom runs on: versions, processors, caches, GPU, server.")
@click.option("--warm", is_flag=True, help="Compile the kernels of the common flows now, which takes minutes.")
@store_option
@json_option
def doctor(warm: bool, store_folder: Path, as_json: bool) -> int:
    """Print what texloom runs on: versions, processors, kernel cache, store, free space, GPU and Prefect server.

    Kernels are compiled when they are first needed, and kept; --warm compiles them ahead, as for an image of a
    container.
    """
    from texloom.pipelines.cli import doctor as examination

    if warm:
        examination.warm(text_stream(as_json))
    found = examination.examine(store_folder)
    if as_json:
        return print_json(found)
    click.echo(examination.described(found))
    return Exit.DONE


@texloom.command(short_help="Print the completion script of a shell.")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> int:
    """Print what SHELL reads to complete commands, flows, steps and params.

    \b
    bash   echo 'eval "$(texloom completion bash)"' >> ~/.bashrc
    zsh    echo 'eval "$(texloom completion zsh)"' >> ~/.zshrc
    fish   texloom completion fish > ~/.config/fish/completions/texloom.fish
    """
    from texloom.pipelines.cli.completion import script

    click.echo(script(shell))
    return Exit.DONE


for _command in (run, compare, plan, commands, flows, stages, check_stage, show, store):
    texloom.add_command(_command)
