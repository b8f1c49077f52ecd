"""train, screen and observe: what every candidate reads under the loads, which of them go on, and what the pool could tell."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from strainsight.config.placement import PlacementConfig, Screen
from strainsight.experiment.structure.candidates import OnSurface, training_units
from strainsight.experiment.structure.clearance import (
    bent_gauges,
    bent_warning,
    clearance_in_words,
    clearance_warning,
    type_in_words,
    type_table,
)
from strainsight.experiment.structure.exclusions import exclusions_in_words
from strainsight.experiment.structure.expectation import loud_noise, quiet_noise, unresolved_candidates
from strainsight.experiment.structure.observation import observed_of
from strainsight.experiment.structure.reduction import inertia_problems
from strainsight.experiment.structure.references import load_units
from strainsight.experiment.structure.screening import screened_of
from strainsight.experiment.structure.training import trained
from strainsight.measurements.calibration import LARGE_STRAIN
from strainsight.mesh.thin_faces import NO_SIDES
from strainsight.ordering import index_of_largest
from strainsight.records.placed import Observed
from strainsight.records.record import written
from strainsight.records.training import Screened
from strainsight.runner.output import Output, Table
from strainsight.runner.stage import Context
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.screening import BEND, CLEARANCE, NEAR, OVER_RANGE, UNSUITABLE
from strainsight.stages import inputs


def run_train(context: Context[PlacementConfig]) -> Output:
    """The training simulation, and where bonded gauges were moved to."""
    reduced = inputs.reduced(context)
    training, surface = trained(context.config, inputs.mesh(context), reduced, context)
    pool, moved = training.candidates, training.moved
    rms = training.rms
    inertia = inertia_problems(context.config.train, training, float(reduced.frequency[0]))
    _warn(unresolved_candidates(training), *inertia)
    strongest = float(rms[pool.quantity == pool.quantity[0]].max())
    steps = len(training.time) - 1
    return Output(
        datasets=written(training, training_units(pool.quantity) | {"the loads": load_units(context.config.loads)}),
        summary={
            "candidates": pool.gauges,
            "left_out": surface.left_out if surface else 0,
            "channels": len(training.rows),
            "steps": steps,
            "strongest_rms": strongest,
        },
        message=_message(pool, steps, strongest, surface, sorted(training.cases)),
        tables=() if moved is None else (_bonded_table(pool, training.name, moved),),
    )


def _message(pool: Candidates, steps: int, strongest: float, surface: OnSurface | None, cases: Sequence[str]) -> str:
    first = pool.first
    kinds = (
        (pool.array[first] == 0) & ~pool.bonded[first],
        pool.bonded[first],
        pool.quantity[first] == 1,
        pool.quantity[first] == 2,
    )
    words = ("candidates", "bonded", "accelerometers", "displacement sensors")
    counts = ", ".join(f"{kind.sum()} {word}" for kind, word in zip(kinds, words, strict=True) if kind.any())
    parts = [counts, f"{steps} time steps, largest RMS strain {1e6 * strongest:.4g} µm/m"]
    if cases:
        parts[1] += f" in {len(cases)} load case{'s' * (len(cases) > 1)}: {', '.join(cases)}"
    if strongest > LARGE_STRAIN:
        parts.append("the strain is unusually large: check the units of loads and moduli")
    if surface is not None:
        moved = float(surface.moved.max(initial=0.0))
        notes = (
            (len(surface.moved), f"bonded gauges moved to the surface by up to {1e3 * moved:.2g} mm"),
            (
                surface.left_out,
                f"locations omitted because the measuring grid would cross a sharp edge: {surface.left_out}",
            ),
            (
                surface.alone,
                f"locations omitted for lack of an opposite facet for the arms of a bridge: {surface.alone}",
            ),
            (surface.twice, f"duplicate bridges omitted (same bridge from the opposite side): {surface.twice}"),
            (len(surface.lines), f"no candidates on {surface.lines}, because {NO_SIDES}"),
            (
                len(surface.empty),
                f"no surface facet in the zone {', '.join(surface.empty)}: specify the zone in metres, in deck coordinates",
            ),
        )
        parts += [text for count, text in notes if count]
    return ", ".join(parts)


def _warn(*texts: str) -> None:
    for text in filter(None, texts):
        warnings.warn(text, stacklevel=3)


def _bonded_table(pool: Candidates, names: Sequence[str], moved: np.ndarray) -> Table:
    """Where the bonded gauges are, of bridges all arms; they are the first candidates."""
    rows = tuple(
        (
            names[i] or f"fixed {i + 1}",
            "/".join(str(element) for element in grids.element),
            "/".join(str(facet) for facet in grids.facet),
            ", ".join(" ".join(f"{x:.4f}" for x in position) for position in grids.position),
            ", ".join(" ".join(f"{round(d, 3) + 0.0:g}" for d in direction) for direction in grids.direction),
            f"{1e3 * moved[i]:.3g} mm",
        )
        for i, c in enumerate(pool.first[: len(moved)])
        for grids in (pool.take(np.array([c])).grids,)
    )
    return Table(
        "positions of the bonded gauges after projection to the surface",
        ("gauge", "element", "facet", "x y z [m]", "direction", "moved by"),
        rows,
    )


def run_screen(context: Context[PlacementConfig]) -> Output:
    """Which candidates go on, and why the others do not."""
    config, structure = context.config, inputs.structure(context)
    screened, pool, training = screened_of(structure), structure.pool, structure.training
    dropped = Counter(str(code) for code in screened.reason if code)
    noise, strain = float(screened.noise_std[0]), pool.quantity[0] == 0
    shown = f"{1e6 * noise:.3g} µm/m" if strain else f"{noise:.3g}"
    parts = [f"{pool.gauges} → {len(screened.kept)}", f"noise {shown}"]
    _warn(*_fewer_than_asked(config.screen, screened, pool))
    if removed := exclusions_in_words(screened, pool):
        parts.append(removed)
    clearance, numbers = screened.clearance, {}
    if clearance is not None:
        parts.append(clearance_in_words(clearance, dropped[CLEARANCE]))
        numbers = {"clearance": clearance.distance}
        _warn(clearance_warning(clearance))
    if dropped[BEND]:
        parts.append(
            f"candidates removed because the surface radius is below the bend radius of the gauge: {dropped[BEND]}"
        )
    bent = bent_gauges(structure)
    if count := int((bent & pool.bonded[pool.first]).sum()):
        parts.append(f"bonded gauges on a surface with a radius below their bend radius: {count}")
    _warn(bent_warning(structure, bent), quiet_noise(training, screened), loud_noise(training, screened))
    if kind := type_in_words(config):
        parts.append(kind)
    return Output(
        datasets=written(screened, training_units(pool.quantity)),
        summary={"candidates": pool.gauges, "kept": len(screened.kept), "noise_std": noise}
        | {f"dropped.{code}": count for code, count in dropped.items()}
        | numbers,
        message=", ".join(parts),
        tables=type_table(config),
    )


def _fewer_than_asked(settings: Screen, screened: Screened, pool: Candidates) -> Iterator[str]:
    """Of every kind of sensor of which spacing and range leave fewer than `screen.keep`."""
    kind = pool.array[pool.first]
    for i in np.unique(kind):
        reasons = screened.reason[kind == i]
        clear = int(np.count_nonzero(~np.isin(reasons, UNSUITABLE)))
        kept_count = int(np.count_nonzero(kind[screened.kept] == i))
        if settings.keep != "all" and kept_count < min(settings.keep, clear):
            name = str(screened.family[int(i)])
            spacing = (
                f"the distance to another candidate is below {1e3 * settings.minimum_spacing:g} mm",
                "reduce screen.minimum_spacing",
            )
            too_large = (
                "the reading exceeds the measuring range",
                "use sensors with a larger measuring range",
            )
            faults, remedy = zip(
                *[words for code, words in ((NEAR, spacing), (OVER_RANGE, too_large)) if code in reasons], strict=True
            )
            yield (
                f"screen.keep requests {settings.keep} candidates of the kind '{name}', but only {kept_count} of {clear} pass "
                f"the screening, because {' or '.join(faults)}. {' or '.join(remedy).capitalize()}."
            )


def run_observe(context: Context[PlacementConfig]) -> Output:
    """Condition of every case, and the worst one at the training motion; of load cases in the worst of them."""
    reduced, training, screened = inputs.reduced(context), inputs.training(context), inputs.screened(context)
    observed = observed_of(context.config, reduced, training, screened, context)
    trained = observed.condition[: len(training.motions)]
    condition = trained.max(axis=0)
    worst = index_of_largest(condition)
    in_load_case = f" in {observed.excitation[index_of_largest(trained[:, worst])]}" * bool(training.cases)
    groups, unknowns = len(condition), _unknowns(observed, worst)
    return Output(
        datasets=written(observed),
        summary={f"condition.{case}": float(value) for case, value in zip(observed.case, condition, strict=True)},
        message=f"{groups} group{'s' * (groups != 1)} of unknowns, largest condition number of the PBH matrix "
        f"{condition[worst]:.2g} for {unknowns}{in_load_case}",
        tables=(_table(observed),),
    )


def _unknowns(observed: Observed, case: int) -> str:
    return observed.unknowns[case].replace(", ", " + ")


def _table(observed: Observed) -> Table:
    rows = tuple(
        (
            _unknowns(observed, j),
            *(f"{value:.3g}" for value in observed.condition[:, j]),
            *(f"{value:.1e}" for value in observed.condition_raw[:, j]),
            "; ".join(dict.fromkeys(filter(None, observed.lost[:, j].tolist()))),
        )
        for j in range(len(observed.case))
    )
    columns = (
        *(f"condition, {e}" for e in observed.excitation),
        *(f"unscaled condition, {e}" for e in observed.excitation),
    )
    title = "observability: condition number of the PBH matrix (Popov-Belevitch-Hautus), scaled and unscaled"
    return Table(title, ("unknown", *columns, "weakly observable"), rows)
