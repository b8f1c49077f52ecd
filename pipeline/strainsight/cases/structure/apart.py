"""Whether records that agree with the model one by one agree with each other: parameters of all against those of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.cases.structure.filtered_test import Filtering
from strainsight.estimation.bank_filters import BankRecord, bank_record
from strainsight.estimation.fault_search import MARGIN, Suspect
from strainsight.estimation.peak import peak_of_records


@dataclass(frozen=True)
class Together:
    """alone: parameter → its most likely value [SI] by each record alone (R,); shared: by all records; gain: ln of how much more
    likely all records are with one set of parameters and bonded gauges than each with its own; words: that they contradict each
    other, empty where they do not."""

    alone: dict[str, np.ndarray]
    shared: dict[str, float]
    gain: float
    words: str


def together_of(each: Sequence[Filtering], suspects: Sequence[Suspect], names: Sequence[str]) -> Together:
    """Records and the banks that judge them one by one.

        ln p(y₁ … y_R) − Σᵣ ln p(yᵣ)

    Of records of one test it is large, as parameters and constants that fit one fit all; records of other parameters, or of
    gauges that were bonded anew in between, have one below −MARGIN. Both as of `peak_of`, which gives up on what no parameters
    explain before a bank would.
    """
    records: list[BankRecord] = []
    alone: list[BankRecord] = []
    for given, own in zip(each, suspects, strict=True):
        for nuisances, found in ((own.nuisances, alone), (given.nuisances, records)):
            learned = replace(nuisances, learned=True)
            found.append(bank_record(own.model, own.known, own.samples, learned, own.settled))
    first = suspects[0]
    peaks = [peak_of_records([own], first.mean, first.covariance, first.biased) for own in alone]
    in_place = [records[i] for i in np.argsort([given.record for given in each])]
    of_all = peak_of_records(in_place, first.mean, first.covariance, first.biased)
    unknowns = each[0].problem.unknowns
    values = {
        name: unknowns.guess[name] * np.exp([peak.point[i] for peak in peaks])
        for i, name in enumerate(unknowns.parameters)
    }
    gain = of_all.evidence - sum(peak.evidence for peak in peaks)
    words = ""
    if gain < -MARGIN:
        said = [
            f"{name} {', '.join(f'{value:.4g} ({of})' for value, of in zip(own, names, strict=True))}"
            for name, own in values.items()
        ]
        words = f"the records contradict each other: each alone says {'; '.join(said) or 'other errors of the gauges'}"
    shared = {name: float(unknowns.guess[name] * np.exp(of_all.point[i])) for i, name in enumerate(unknowns.parameters)}
    return Together(values, shared, float(gain), words)
