"""Whether records that agree with the model one by one agree with each other: parameters of all against those of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.cases.structure.filtered_test import Filtered, Filtering
from strainsight.estimation.fault_search import MARGIN, Suspect
from strainsight.estimation.peak import peak_of


@dataclass(frozen=True)
class Together:
    """alone: parameter → its most likely value [SI] by each record alone (R,); gain: ln of how much more likely all records are
    with one set of parameters and bonded gauges than each with its own; words: that they contradict each other, empty where
    they do not."""

    alone: dict[str, np.ndarray]
    gain: float
    words: str


def together_of(
    each: Sequence[Filtering], suspects: Sequence[Suspect], found: Sequence[Filtered], names: Sequence[str]
) -> Together:
    """Records and the banks that judge them one by one, and what the bank of all of them found.

        ln p(y₁ … y_R) − Σᵣ ln p(yᵣ)

    Of records of one test it is large, as one set of constants has to fit all; records of different parameters, or gauges that
    were bonded anew in between, have one below −MARGIN. p(yᵣ) as of `peak_of`.
    """
    peaks = [
        peak_of(
            own.model,
            own.mean,
            own.covariance,
            own.known,
            own.samples,
            replace(own.nuisances, learned=True),
            own.biased,
            own.settled,
        )
        for own in suspects
    ]
    unknowns = each[0].problem.unknowns
    alone = {
        name: unknowns.guess[name] * np.exp([peak.point[i] for peak in peaks])
        for i, name in enumerate(unknowns.parameters)
    }
    gain = float(sum(own.run.log_likelihood[0] for own in found) - sum(peak.evidence for peak in peaks))
    words = ""
    if gain < -MARGIN:
        said = [
            f"{name} {', '.join(f'{value:.4g} ({of})' for value, of in zip(values, names, strict=True))}"
            for name, values in alone.items()
        ]
        words = f"the records contradict each other: each alone says {'; '.join(said) or 'other errors of the gauges'}"
    return Together(alone, gain, words)
