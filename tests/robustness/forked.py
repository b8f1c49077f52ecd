"""Processes of the command line without the second that its imports take: one imports, the others are forked from it.

`python -m` on this file reads a line of JSON, the words after `strainsight`, and answers with the number of the process that
runs them; when that has ended, with its exit code as Python tells it, -9 for a kill.
"""

from __future__ import annotations

import atexit
import importlib
import json
import os
import signal
import sys

NEEDED = (
    "strainsight.config.load",
    "strainsight.stages.placement",
    "strainsight.stages.estimate",
    *(f"strainsight.stages.bench.{name}" for name in ("pipeline", "import_bodies", "place", "simulate")),
    *(f"strainsight.stages.bench.{name}" for name in ("estimate", "field", "report")),
    "strainsight.runner.runner",
    "strainsight.fem.factorisation",
    "rich.console",
    "rich.table",
    "matplotlib.figure",
    "matplotlib.backends.backend_svg",
    "joblib.externals.loky",
    "scipy.optimize",
    "scipy.signal",
    "scipy.spatial",
    "scipy.stats",
)


def serve() -> None:
    from strainsight_cli.main import main

    with open(os.devnull, "w") as nowhere:
        for name in NEEDED:
            importlib.import_module(name)
        while line := sys.stdin.readline():
            pid = os.fork()
            if pid == 0:
                os.setsid()  # whatever it starts is found by its session
                signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests themselves may run under nohup
                os.dup2(nowhere.fileno(), 0)
                asked = json.loads(line)
                out = os.open(asked["says"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
                os.dup2(out, 1)
                os.dup2(out, 2)
                sys.argv = ["strainsight", *asked["words"]]
                code = 1
                try:
                    main()
                except SystemExit as end:
                    code = end.code or 0
                finally:
                    atexit._run_exitfuncs()
                    sys.stdout.flush()
                    sys.stderr.flush()
                    os._exit(code)
            print(pid, flush=True)
            print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)


if __name__ == "__main__":
    serve()
