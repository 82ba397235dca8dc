"""Earlier results by their EXR files: the patches from which they were voted, found in the store.

The header of an EXR that a run has exported names the step that made it. That step, or one from which its picture
or its correspondence came, holds the patches, see `texloom.stages.vocabulary.voted_patches`.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from texloom.pipelines.media.headers import Refusal
from texloom.pipelines.store import codec, exr, run_log
from texloom.pipelines.store.result_files import NOT_AS_EXPECTED, BrokenArtifactError, read_manifest
from texloom.pipelines.store.store import Store
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary.sizes import size_value
from texloom.stages.vocabulary.voted_patches import VotedPatches

_STAGE = "synthesis.optimise"
_OUTPUTS = ("patches", "voting")
_CARRIED = ("image", "match")
"""inputs of later steps by which pixels stay where they are"""
_CARRIERS = ("synthesis.gradient_domain", "synthesis.restore_tone", "synthesis.whole_parts")
"""those steps"""


def find(path: Path, store: Store) -> tuple[str, str]:
    """The folder in the store with the patches of a result, and a digest of them.

    Raises
    ------
    Refusal : the file is no EXR of a run, its result was voted otherwise, or the store has it no more.
    FileNotFoundError : there is no such file.
    """
    if not path.exists():
        raise FileNotFoundError(path)
    try:
        header, _ = exr.load(path, pixels=False)
        made = json.loads(header["texloom.provenance"])
        stage, key, inputs = str(made["stage"]), str(made["key"]), dict(made["inputs"])
    except NOT_AS_EXPECTED:
        raise Refusal("is not an EXR that a run of texloom has written, as its texture.exr") from None
    again = _again(header, made, store)
    passed = {key}  # a step that changes nothing has made what it was given
    while stage in _CARRIERS:
        wanted = {inputs[name] for name in _CARRIED if name in inputs}
        found = (one for one in _results(store) if one["key"] not in passed)
        before = next((one for one in found if wanted & {*one["outputs"].values()}), None)
        if before is None:
            raise Refusal(f"its correspondence is no longer in the store {store.root}; {again}")
        stage, key, inputs = before["stage"], before["key"], before["inputs"]
        passed.add(key)
    if stage != _STAGE:
        raise Refusal(f"was made by {stage}, of which no correspondence is kept; self_tuning and materials keep it")
    return _checked(key, store, again)


def _results(store: Store) -> Iterator[Mapping[str, Any]]:
    """The manifests of results, those first that have patches."""
    for stage in (_STAGE, *_CARRIERS):
        folder = store.root / "cache" / stage
        for place in sorted(folder.iterdir()) if folder.is_dir() else ():
            with contextlib.suppress(BrokenArtifactError):
                yield read_manifest(place)[0]


def _checked(key: str, store: Store, again: str) -> tuple[str, str]:
    try:
        artifact = store.find(_STAGE, key)
        if artifact is None:
            raise Refusal(f"its correspondence is no longer in the store {store.root}; {again}")
        if any(name not in artifact.outputs for name in _OUTPUTS):
            raise Refusal(f"was made by an earlier version, which did not keep its correspondence; {again}")
        if not codec.read(find_stage(_STAGE).result, artifact.folder, ["voting"])["voting"]:
            raise Refusal("keeps pixels of a picture, as edits do; give a result that is new throughout")
    except (codec.ArtifactError, BrokenArtifactError) as error:
        raise Refusal(f"its correspondence in the store {store.root} is broken ({error}); {again}") from None
    digest = hashlib.sha256("".join(artifact.outputs[name] for name in _OUTPUTS).encode()).hexdigest()
    return str(artifact.folder), digest


def _again(header: Mapping[str, Any], made: Mapping[str, Any], store: Store) -> str:
    """The command that makes a result again, as far as its header and the log of runs tell it."""
    flow = str(made.get("flow"))
    runs = (run for run in run_log.read(store.root) if run.flow == flow)
    logged = next((run for run in runs if made["key"] in run.steps.values()), None)
    words = ["texloom", "run", flow]
    if logged is not None:
        words += [*list(logged.sources.values())[:1], "--seed", str(logged.seeds[0])]
    words += ["--size", size_value(exr.data_size(header))]
    with contextlib.suppress(*NOT_AS_EXPECTED):  # what does not tile says nothing
        wraps = next(iter(json.loads(header["texloom.arrays"]).values()))["facts"]["wraps"]
        words.append("--tileable" if wraps == "both" else f"--tileable={wraps}")
    return f"make it again: {shlex.join(words)}, with the other options of that run"


def read(folder: str) -> VotedPatches:
    """The patches in a folder that `find` has found; `Refusal` where they are broken or gone."""
    try:
        found = codec.read(find_stage(_STAGE).result, Path(folder), _OUTPUTS)
        return VotedPatches.of(found["patches"], found["voting"])
    except (codec.ArtifactError, ValueError) as error:
        raise Refusal(f"its correspondence cannot be read: {error}") from None
