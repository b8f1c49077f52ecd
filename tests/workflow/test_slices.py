"""A stage sees what it declared and nothing else, so that its key is complete."""

from __future__ import annotations

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from strainsight.workflow.slices import Slice, canonical, declared, differences, expand, look_up, prune

CONFIG = {
    "seed": 1,
    "loads": {"tip": {"node": 2, "signal": {"type": "sine", "frequency": 20.0}}, "root": {"node": 1, "signal": None}},
    "parameters": {},
    "place": {"keep": 4, "estimate": ["E"]},
}


def test_a_pattern_keeps_the_nesting_and_drops_the_rest():
    kept = prune(CONFIG, ("seed", "loads.*.node", "place.keep"))
    assert kept == {"seed": 1, "loads": {"tip": {"node": 2}, "root": {"node": 1}}, "place": {"keep": 4}}


def test_an_empty_mapping_below_a_star_stays_readable():
    assert prune(CONFIG, ("parameters.*.guess",)) == {"parameters": {}}


def test_a_pattern_goes_through_lists_by_their_places():
    config = {"mesh": {"terms": [{"file": "k0.op4"}, {"file": "k1.mtx", "name": "KGG"}], "other": None}}
    assert expand(config, "mesh.terms.*.file") == ["mesh.terms.0.file", "mesh.terms.1.file"]
    assert expand(config, "mesh.*.*.name") == ["mesh.terms.1.name"]
    assert expand(config, "mesh.other.*.file") == []
    assert [look_up(config, key) for key in expand(config, "mesh.terms.*.file")] == ["k0.op4", "k1.mtx"]
    assert prune(config, ("mesh.terms",)) == {"mesh": {"terms": config["mesh"]["terms"]}}


def test_a_declared_key_that_the_config_lacks_is_a_mistake_of_the_stage():
    with pytest.raises(ValueError, match=r"place\.kept"):
        prune(CONFIG, ("place.kept",))


def test_an_undeclared_key_is_refused_with_the_missing_declaration():
    view = Slice(prune(CONFIG, ("loads.*.node",)), "rom")
    assert view.loads["tip"].node == view.loads.tip.node == 2
    with pytest.raises(AttributeError, match=r"stage 'rom' reads 'loads\.tip\.signal' without declaring it"):
        _ = view.loads.tip.signal
    with pytest.raises(KeyError):
        view["place"]
    with pytest.raises(AttributeError, match="read-only"):
        view.seed = 2


def test_differences_are_leaves_with_their_old_and_new_values():
    new = {**CONFIG, "place": {"keep": 6, "estimate": ["E"]}, "extra": 1}
    assert differences(CONFIG, new) == [("place.keep", 4, 6), ("extra", ..., 1)]
    assert differences(new, CONFIG) == [("place.keep", 6, 4), ("extra", 1, ...)]


def test_equal_values_have_one_text_and_nan_has_none():
    assert canonical({"b": 1.0, "a": [1, 2]}) == canonical({"a": (1, 2), "b": 1.0})
    with pytest.raises(ValueError):
        canonical(float("nan"))


class Place(BaseModel):
    model_config = ConfigDict(frozen=True)
    keep: int
    estimate: tuple[str, ...] = ("E",)


class Load(BaseModel):
    node: int | None = None
    signal: str = "sine"


class Whole(BaseModel):
    place: Place
    loads: dict[str, Load]
    validation: Place = Field(alias="validate")


def test_a_declared_model_keeps_its_types_and_only_the_declared_keys():
    model = Whole.model_validate({"place": {"keep": 4}, "loads": {"tip": {"node": 2}}, "validate": {"keep": 9}})
    data = prune(model.model_dump(mode="json", by_alias=True), ("place.keep", "loads.*.node", "validate"))
    own = declared(model, data)
    assert isinstance(own, Whole)
    assert isinstance(own.loads["tip"], Load)
    assert (own.place.keep, own.loads["tip"].node, own.validation.estimate) == (4, 2, ("E",))
    for missing in (lambda: own.place.estimate, lambda: own.loads["tip"].signal):
        with pytest.raises(AttributeError):
            missing()
    with pytest.raises(ValidationError, match="frozen"):
        own.place.keep = 5
