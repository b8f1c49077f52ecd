"""`strainsight figures`: the figures of a run's page as files, with their numbers."""

from __future__ import annotations

from strainsight_cli import pipelines
from strainsight_cli.failures import reported
from strainsight_cli.options import DEFAULT_RESULTS, ConfigFile, Results, Set, Verbose
from strainsight_cli.view import say_stale, viewable


def figures(
    config: ConfigFile, results: Results = DEFAULT_RESULTS, overrides: Set = None, verbose: Verbose = False
) -> None:
    with reported(verbose):
        from strainsight.config.load import load_config
        from strainsight.report.chart.files import write_figures
        from strainsight.stages.figures import figures_of

        loaded = load_config(config, overrides or ())
        model = viewable(loaded, config)
        folder = results / str(loaded.data["name"])
        report = pipelines.stages_of(loaded.data)[-1]
        files = figures_of(model, report, folder, str(config))
        say_stale(loaded, results, report.upstream)
        write_figures(folder / "figures", files)
        count = sum(name.endswith(".svg") for name in files)
        print(f"wrote {count} figures as SVG, PNG and CSV: {folder / 'figures'}")
