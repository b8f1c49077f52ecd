"""Names by which one entry of a config means another: marked in the models, checked in one place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

from pydantic import BaseModel

from strainsight.config.base import Text
from strainsight.config.marks import marked
from strainsight.config.problem import Problem, known


@dataclass(frozen=True)
class Names:
    """Marks a text as the name of an entry of a section: what that is called, its `type` if only one will do, and what may
    be named besides."""

    section: str
    what: str
    type: str | None = None
    besides: tuple[str, ...] = ()


GROUND = "ground"
BodyName = Annotated[Text, Names("bodies", "body", besides=(GROUND,))]
FlexibleName = Annotated[Text, Names("bodies", "flexible body", type="flexible")]
FrameName = Annotated[Text, Names("frames", "frame")]
JointName = Annotated[Text, Names("joints", "joint")]
BearingName = Annotated[Text, Names("bearings", "bearing")]


def name_problems(config: BaseModel) -> Iterator[Problem]:
    """A problem for every name of what is not there."""
    for name in marked(config, Names):
        mark = name.mark
        entries = getattr(config, mark.section)
        there = [own for own, entry in entries.items() if mark.type is None or entry.type == mark.type]
        yield from known(name.field, str(name.value), [*there, *mark.besides], mark.what)
