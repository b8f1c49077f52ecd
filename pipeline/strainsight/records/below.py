"""Datasets of a part of an artefact: written below a group, read as if they stood at the root."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from strainsight.workflow.artefact import Artefact
from strainsight.workflow.output import Dataset


def below(group: str, datasets: Mapping[str, Dataset]) -> dict[str, Dataset]:
    """The same datasets, and what scales them, below a group ("/bodies/hub")."""
    return {
        group + path: replace(entry, scales=tuple(scale and group + scale for scale in entry.scales))
        for path, entry in datasets.items()
    }


@dataclass(frozen=True)
class Below:
    """A group of an artefact with the artefact's own way of being read."""

    artefact: Artefact
    group: str

    def __getitem__(self, path: str) -> np.ndarray:
        return self.artefact[self.group + path]

    def __contains__(self, path: str) -> bool:
        return self.group + path in self.artefact

    def children(self, path: str) -> dict[str, np.ndarray]:
        return self.artefact.children(self.group + path)

    def groups(self, path: str) -> tuple[str, ...]:
        return self.artefact.groups(self.group + path)

    def attributes(self, path: str) -> dict[str, Any]:
        return self.artefact.attributes(self.group + path)
