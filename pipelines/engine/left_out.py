"""Which results that were left out of the store a run has to compute again."""

from collections.abc import Callable, Mapping, Sequence

from texloom.pipelines.engine.scope import Scope
from texloom.pipelines.flow.model import Flow, Reference


def wanted_again(
    flow: Flow, shared: Scope, items: Sequence[Scope], exports_of: Callable[[str], Mapping[str, Reference]]
) -> dict[str, str]:
    """Key of each result that was left out and that something takes, to what takes it.

    The steps are gone through from the last one to the first: what is cached takes nothing.

    Parameters
    ----------
    items : scopes of the items whose files are there.
    exports_of : the exports of the steps of a scope: ``final``, ``item`` or ``shared``.
    """
    if not any(one.left_out for scope in (shared, *items) for one in scope.artifacts.values()):
        return {}
    wanted: dict[str, str] = {}

    def ask(name: str, taker: str, scope: Scope) -> None:
        of_items = flow.steps[name].scope == "item" and scope.item is None
        for place in items if of_items else [scope]:
            artifact = place.artifact(name)
            if artifact is not None and artifact.left_out:
                wanted.setdefault(artifact.key, taker)

    for kind in ("final", "item", "shared"):
        for scope in items if kind == "item" else [shared]:
            for file, reference in exports_of(kind).items():
                if reference.output is not None:
                    ask(reference.name, file, scope)
            for name, step in reversed(list(flow.steps.items())):
                artifact = scope.artifacts.get(name)
                is_cached = artifact is not None and artifact.key not in wanted
                if step.scope == kind and not is_cached and scope.why_passed_over(name) is None:
                    for needed in step.needs:
                        ask(needed, name, scope)
    return wanted
