"""The numbers of a suite of benches as datasets and as tables: a row a run, a row an unknown, a row a claim."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from strainsight.report.bench.claims import asked, measured
from strainsight.report.bench.data import BenchRun, BenchSuite, BenchUnknown
from strainsight.workflow.output import Dataset, Table

KEYS = ("error", "std", "slope", "offset", "ratio_slope", "ratio_offset")
"""Numbers of an unknown that the file keeps."""
MEANING = {
    "error": ("1", "error, relative to the largest true load or to the true parameter"),
    "std": ("1", "claimed standard deviation, relative to the same"),
    "slope": ("1", "slope of the fit estimate = slope · truth + offset"),
    "offset": ("N or N m", "offset of that fit"),
    "ratio_slope": ("1", "slope of the load over that of the bench that was measured"),
    "ratio_offset": ("N or N m", "offset of that fit"),
}


def suite_datasets(suite: BenchSuite) -> dict[str, Dataset]:
    """Tables of the runs, of their unknowns and of the claims; NaN for what was not computed."""
    unknowns = [
        (i, run, u) for i, run in enumerate(suite.runs) for u in (run.estimate.unknowns if run.estimate else ())
    ]
    record = {
        "/run/name": _texts((run.name for run in suite.runs), "name of every run"),
        "/run/label": _texts((run.label for run in suite.runs), "what the page calls it", "/run/name"),
        "/run/study": _texts((run.study for run in suite.runs), "its study", "/run/name"),
        "/run/group": _texts((run.group for run in suite.runs), "its group", "/run/name"),
        "/run/reached": _texts((run.reached for run in suite.runs), "its last stage", "/run/name"),
        "/run/at": _values((run.at for run in suite.runs), "SI", "value of the key that its study varies", "/run/name"),
        "/run/nis": _values((run.number("nis") for run in suite.runs), "1", "mean NIS over channels", "/run/name"),
        "/unknown/run": Dataset(
            np.array([i for i, _, _ in unknowns], dtype=np.int64), "1", "row of its run", ("/unknown/name",)
        ),
        "/unknown/name": _texts((u.name for _, _, u in unknowns), "name of every unknown of every run"),
        "/claim/text": _texts((claim.text for claim in suite.claims), "every statement"),
        "/claim/verdict": _texts(
            (claim.verdict for claim in suite.claims), "confirmed, contradicted or no number", "/claim/text"
        ),
    }
    for key in KEYS:
        unit, what = MEANING[key]
        record[f"/unknown/{key}"] = _values((_of(run, u, key) for _, run, u in unknowns), unit, what, "/unknown/name")
    found = [(i, *entry) for i, claim in enumerate(suite.claims) for entry in claim.found]
    return record | {
        "/number/claim": Dataset(
            np.array([i for i, *_ in found], dtype=np.int64), "1", "row of the claim of every number"
        ),
        "/number/run": Dataset(np.array([place for _, place, _, _ in found], dtype=np.int64), "1", "row of its run"),
        "/number/name": _texts((name for _, _, name, _ in found), "its name in the stage's summary"),
        "/number/value": _values((value for *_, value in found), "SI", "its value, after times and against"),
    }


def suite_tables(suite: BenchSuite) -> tuple[Table, ...]:
    """Statements and unknowns for the terminal."""
    tables = []
    if suite.claims:
        rows = tuple((claim.text, asked(claim), measured(claim), claim.verdict) for claim in suite.claims)
        tables.append(Table("statements", ("statement", "asked", "measured", ""), rows))
    lines = tuple(line for run in suite.runs for line in _rows(run))
    return (*tables, Table(suite.title, ("run", "unknown", "error", "claimed σ", "slope", "load ratio"), lines))


def _rows(run: BenchRun) -> Iterable[tuple[str, ...]]:
    unknowns = run.estimate.unknowns if run.estimate is not None else ()
    if not unknowns:
        yield run.label, "", f"not estimated ({run.reached})", "", "", ""
    for i, unknown in enumerate(unknowns):
        slope, ratio = (_of(run, unknown, key) for key in ("slope", "ratio_slope"))
        yield (
            run.label if i == 0 else "",
            unknown.name,
            *(_percent(_of(run, unknown, key)) for key in ("error", "std")),
            "" if slope is None else f"{slope:.5g}",
            "" if ratio is None else f"{ratio:.5g}",
        )


def _of(run: BenchRun, unknown: BenchUnknown, key: str) -> float | None:
    return run.number(f"{key}.{unknown.name}")


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.2g} %"


def _texts(values: Iterable[str], what: str, scale: str = "") -> Dataset:
    return Dataset(np.array(list(values), dtype=np.str_), "1", what, (scale,) if scale else ())


def _values(values: Iterable[float | None], unit: str, what: str, scale: str = "") -> Dataset:
    array = np.array([np.nan if value is None else value for value in values], dtype=float)
    return Dataset(array, unit, what, (scale,) if scale else ())
