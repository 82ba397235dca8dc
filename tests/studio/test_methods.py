"""What the page offers of each method is what its flow takes."""

from __future__ import annotations

import json

import pytest

from texloom.pipelines.flow.loader import find_flow
from texloom.pipelines.flow.model import Flow, Overrides
from texloom.pipelines.flow.seed_sheet import open_flow
from texloom.pipelines.studio.messages.catalogue import Method
from texloom.pipelines.studio.methods import methods
from texloom.pipelines.studio.offers import OFFERS

METHODS = {one.flow: one for one in methods()}


def value(flow: Flow, param: str) -> object:
    """What a param is by itself."""
    step, _, name = flow.params.get(param, (param,))[0].partition(".")
    return getattr(flow.steps[step].params, name)


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_what_is_offered_is_taken(method: Method) -> None:
    flow = open_flow(find_flow(method.flow), Overrides())
    assert {one.source for one in method.others} <= {*flow.sources, *flow.optional}
    assert method.several is None or next(iter(flow.sources)) == method.several.source
    assert {one.file for one in method.views} <= flow.exports.keys() | flow.unwritten.keys()
    for control in method.controls:
        assert value(flow, control.param) == pytest.approx(control.default, abs=1e-3)
        for end in (control.least, control.most):
            text = json.dumps(bool(end)) if control.is_switch else json.dumps(end)
            open_flow(find_flow(method.flow), Overrides(params={control.param: text}))
    for choice in method.choices:
        assert not choice.settings[0].params
        assert not choice.settings[0].lists
        assert choice.without in ("", *(one.source for one in method.others))
        for setting in choice.settings:
            given = {name: json.dumps(one) for name, one in {**setting.params, **setting.lists}.items()}
            delivery = {"udim": setting.udim} if setting.udim else {}
            changed = open_flow(find_flow(method.flow), Overrides(params=given, delivery=delivery))
            if setting.udim:
                assert f"{setting.udim}" == json.loads(given["variants"])
            for name in given:
                assert value(changed, name) != value(flow, name)


def test_the_lengths_that_previews_reduce_are_params_of_the_flow() -> None:
    for name, offer in OFFERS.items():
        flow = open_flow(find_flow(name), Overrides())
        for param in offer.lengths:
            value(flow, param)
