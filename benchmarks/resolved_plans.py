"""What every flow resolves to: the stage, params, inputs and random numbers of each step, and what is exported.

    python -m benchmarks.resolved_plans > plans.json
    python -m benchmarks.resolved_plans --against OTHER/.venv/bin/python

The second form compares with the texloom that another interpreter imports, as that of a clone of an earlier commit,
and prints what of a plan there is missing or different here, or added. It exits with 1 unless all steps are the
same and nothing else is missing. Flows that are merged into another since are compared by the commands that replace
them (`MERGED`), in which steps may have other names (`RENAMED`). Nothing is computed, so pictures need not exist.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

MERGED: dict[str, str] = {
    "inverse a.png --source control=b.png": "inverse a.png --source control=b.png",
    "inverse_stationary": "inverse",
    "masked a.png --source mask=b.png": "self_tuning a.png --source mask=b.png",
    "self_tuning_guided a.png --source exemplar_guide=b.png --source target_guide=c.png": (
        "self_tuning a.png --source exemplar_guide=b.png --source target_guide=c.png"
    ),
    "self_tuning_oriented a.png --source strokes=b.png": "self_tuning a.png --source strokes=b.png",
    "self_tuning_set [ab].png": "self_tuning [ab].png",
    "self_tuning_structured a.png --source exemplar_structure=b.png": (
        "self_tuning a.png --source exemplar_structure=b.png"
    ),
    "self_tuning_tone a.png --source control=b.png": "self_tuning a.png --source control=b.png",
}
"""command of an earlier flow to that which replaces it, or does the same where sources are optional now"""
RENAMED: dict[str, dict[str, str | None]] = {
    "self_tuning_guided": {"detected": "structure", "structure": None},
    "self_tuning_oriented": {"detected": "structure", "structure": None, "guide": "along"},
    "self_tuning_structured": {"detected": "structure", "structure": "painted"},
}
"""earlier flow to the names of its steps, before and now; None: the step passed on what it took and is left out"""


def resolved(command: str) -> dict[str, Any] | None:
    """The plan of a command, as the texloom of this interpreter resolves it; None if it does not have the flow."""
    from texloom.pipelines.flow.loader import find_flow, load_flow
    from texloom.pipelines.flow.model import Overrides
    from texloom.stages.vocabulary.declare import InputError

    name, *words = command.split()
    given: dict[str, list[str]] = {"--source": [], "--set": [], "": []}
    for before, word in zip(["", *words], words, strict=False):
        if word not in given:
            given[before if before in given else ""].append(word)
    sources, params = (dict(text.split("=", 1) for text in given[kind]) for kind in ("--source", "--set"))
    try:
        path = find_flow(name)
    except InputError:
        return None
    flow = load_flow(path, Overrides(sources=sources, params=params, pictures=tuple(given[""])))
    plan = {
        "steps": {name: described(step) for name, step in flow.steps.items()},
        "seeds": flow.seeds,
        "picture": next(iter(flow.sources), None),
        "sources": {name: str(source) for name, source in flow.sources.items()},
        "params": flow.params,
        "exports": {file: str(reference) for file, reference in flow.exports.items()},
    }
    text = json.dumps(plan)
    for folder in (path.parent, path.parent.resolve()):
        text = text.replace(str(folder), "configs")
    return dict(json.loads(text.replace(str(Path.cwd()), ".")))


def described(step: Any) -> dict[str, Any]:
    """All of a step that its result depends on, and when it runs."""

    def texts(gathered: Any) -> Any:
        return {label: str(one) for label, one in gathered.items()} if isinstance(gathered, dict) else str(gathered)

    return {
        "stage": step.stage.name,
        "params": step.params.model_dump(mode="json"),
        "inputs": {key: str(reference) for key, reference in step.inputs.items()},
        "gather": {key: texts(gathered) for key, gathered in step.gather.items()},
        "draws_as": step.draws_as if step.stage.uses_rng else "",
        "scope": step.scope,
    }


def of_interpreter(interpreter: str, commands: list[str]) -> dict[str, Any]:
    """Command to its plan with the texloom of an interpreter."""
    done = subprocess.run(
        [interpreter, "-P", __file__, "--commands", *commands], check=True, capture_output=True, text=True
    )
    return dict(json.loads(done.stdout))


def flow_names(interpreter: str) -> list[str]:
    """The flows of an interpreter's texloom."""
    code = "from texloom.pipelines.flow.shipped import shipped_flows; print(*shipped_flows())"
    return subprocess.run(
        [interpreter, "-P", "-c", code], check=True, capture_output=True, text=True
    ).stdout.split()


def renamed(plan: dict[str, Any], names: dict[str, str | None]) -> dict[str, Any]:
    """A plan whose steps have other names."""

    def change(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: change(one) for key, one in value.items()}
        if isinstance(value, list):
            return [change(one) for one in value]
        step, dot, output = value.partition(".") if isinstance(value, str) else ("", "", "")
        return f"{names[step]}.{output}" if dot and names.get(step) else value

    named = {names.get(name, name): change(step) for name, step in plan["steps"].items()}
    return {**change(plan), "steps": {name: step for name, step in named.items() if name is not None}}


def differences(before: dict[str, Any], after: dict[str, Any]) -> Iterator[tuple[bool, str]]:
    """What is not the same in two plans, and whether it counts."""
    for part in ("seeds", "picture"):
        if before[part] != after[part]:
            yield True, f"{part}: {before[part]} -> {after[part]}"
    for part in ("steps", "sources", "params", "exports"):
        for name in {**before[part], **after[part]}:
            old, new = (plan[part].get(name) for plan in (before, after))
            if old is None:
                yield part == "steps", f"{part}.{name}: added: {new}"
            elif part == "steps" and new is not None:
                for key in old:
                    if old[key] != new[key]:
                        yield True, f"steps.{name}.{key}: {old[key]} -> {new[key]}"
            elif old != new:
                is_less = part != "params" or new is None or not set(old) <= set(new)
                yield is_less, f"{part}.{name}: {old} -> {new or 'gone'}"


def compare(interpreter: str) -> int:
    """Print what differs; how many flows do."""
    named = (name for name in flow_names(interpreter) if not any(old.startswith(f"{name} ") for old in MERGED))
    commands = {name: name for name in named} | MERGED
    before = of_interpreter(interpreter, list(commands))
    after = of_interpreter(sys.executable, list(commands.values()))
    count = 0
    for old, new in commands.items():
        if after[new] is None:
            if not any(merged.split()[0] == old for merged in MERGED):
                count += 1
                print(f"{old}: gone")
            continue
        found = list(differences(renamed(before[old], RENAMED.get(old.split()[0], {})), after[new]))
        count += any(counts for counts, _ in found)
        label = old if old == new else f"{old} -> {new}"
        print("".join(f"{label}: {line}\n" for _, line in found), end="")
    print(f"{count} of {len(commands)} plans differ")
    return count


def main() -> None:
    """Read the options; print all plans, or what differs."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--against", metavar="PYTHON", help="interpreter of another environment to compare with")
    parser.add_argument("--commands", nargs="+", metavar="COMMAND", help="those to resolve, as 'fill a.png'")
    options = parser.parse_args()
    if options.against is not None:
        sys.exit(bool(compare(options.against)))
    commands = options.commands or flow_names(sys.executable)
    print(json.dumps({command: resolved(command) for command in commands}, indent=1))


if __name__ == "__main__":
    main()
