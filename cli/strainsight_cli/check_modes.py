"""`strainsight check-modes`: compare frequencies and mode shapes of another program with those of the deck of a config."""

from __future__ import annotations

from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from typing import Annotated

import typer

from strainsight.errors import ConfigError
from strainsight_cli import pipelines
from strainsight_cli.failures import INCONSISTENT, reported
from strainsight_cli.options import DEFAULT_RESULTS, ConfigFile, Results, Set, Verbose
from strainsight_cli.printing import Level, json_line, say, shown
from strainsight_cli.render import print_tables
from strainsight_cli.work import bring_up_to_date


def check_modes(
    config: ConfigFile,
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Result file of another program with its modes: .f06, .op2, .pch, .dat or .frd (CalculiX), .unv, .rst, "
            ".vtu; also compressed (.gz).",
        ),
    ],
    tolerance: Annotated[
        float, typer.Option("--tolerance", min=0.0, help="Largest accepted frequency difference [%].")
    ] = 1.0,
    mac: Annotated[
        float, typer.Option("--mac", min=0.0, max=1.0, help="Smallest accepted MAC, if the file has mode shapes.")
    ] = 0.9,
    step: Annotated[int | None, typer.Option("--step", help="Step or subcase, if several contain modes.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object per mode.")] = False,
    results: Results = DEFAULT_RESULTS,
    overrides: Set = None,
    verbose: Verbose = False,
) -> None:
    with reported(verbose):
        from strainsight.config.placement import PlacementConfig
        from strainsight.experiment.structure.modes_compared import modes_compared, modes_of_file
        from strainsight.records.mesh import mesh_from
        from strainsight.runner.output import Table

        work = pipelines.work_of_one(config, results, overrides, "modes")
        model = work.job.model
        if not isinstance(model, PlacementConfig):
            raise ConfigError(
                f"`check-modes` does not support the kind {getattr(model, 'kind', None)}",
                key="kind",
                where=str(config),
                remedy="use a config with `kind: placement`",
            )
        theirs = modes_of_file(file, step)
        only = replace(work, stages=work.stages[:1])
        (imported,) = bring_up_to_date(only, [], as_json, verbose, lambda _: None, lambda *_: None)
        comparison = modes_compared(model, mesh_from(imported), theirs)
        pairs, with_shapes = comparison.pairs, comparison.over is not None
        worst, least = max(abs(pair.off) for pair in pairs), min(pair.mac for pair in pairs)
        agrees = 100 * worst <= tolerance and not (with_shapes and least < mac)
        for note in comparison.notes if shown(Level.WARNING) else ():
            say(f"warning: {note}", error=True)
        if as_json:
            for pair in pairs:
                off, shape = pair.off if isfinite(pair.off) else None, pair.mac if with_shapes else None
                say(json_line({**asdict(pair), "off": off, "mac": shape}))
        else:
            head = ("file mode", "file [Hz]", "deck mode", "deck [Hz]", "difference [%]", *(("MAC",) * with_shapes))
            rows = [
                (
                    str(pair.number),
                    f"{pair.theirs:.6g}",
                    str(pair.mode),
                    f"{pair.ours:.6g}",
                    f"{100 * pair.off:+.3g}" if isfinite(pair.off) else "–",
                    *((f"{pair.mac:.4f}",) * with_shapes),
                )
                for pair in pairs
            ]
            print_tables([Table(f"modes of the file {file.name} and of the deck", head, tuple(rows))])
            shapes = "; mode shapes are not compared"
            if comparison.over is not None:
                over = f"computed at {comparison.over[0]} of {comparison.over[1]} nodes"
                shapes = f", smallest MAC {least:.4f} (limit {mac:g}), {over}"
            elif not any(len(pair.node_ids) for pair in theirs):
                shapes = "; the file has no mode shapes"
            largest = f"{100 * worst:.3g} % (limit {tolerance:g} %)" if isfinite(worst) else "undefined (mode at 0 Hz)"
            result = "agree" if agrees else "disagree"
            modes = f"{len(pairs)} mode{'s' * (len(pairs) != 1)} of the file and of the deck"
            say(f"{modes} {result}: largest frequency difference {largest}{shapes}")
        if not agrees:
            raise typer.Exit(INCONSISTENT)
