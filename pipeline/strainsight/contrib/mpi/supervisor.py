"""The process between strainsight and MPI's launcher: when either ends, however it does, it ends the other's and clears up.

A run that is interrupted leaves at once, without another line of its own (`strainsight_cli.failures`). So the private folder is
made and removed here: stdin that is closed says that nobody is there any more.
"""

from __future__ import annotations

import json
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

ENDED, END, SAID = "ended.json", "end", "said.txt"
"""Files of the folder: how the launcher ended; that it may end by itself; what it and its processes have printed."""
LOOK = 0.05
"""[s] between two looks at launcher and parent."""
PATIENCE = 5.0
"""[s] for a launcher to end what it has started."""
ENDING = (signal.SIGTERM, signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGTERM))
KILL = getattr(signal, "SIGKILL", signal.SIGTERM)


def _leave(number: int, _: object) -> None:
    raise SystemExit(128 + number)


def _end(process: subprocess.Popen[bytes], signalled: bool) -> None:
    """By SIGTERM, which a launcher passes on; its processes end with it in any case. Where this process was ended by a signal the
    launcher has mostly had one, too, and a second one would keep it from clearing up."""
    if signalled:
        with suppress(subprocess.TimeoutExpired):
            process.wait(PATIENCE)
    for number in (signal.SIGTERM, KILL):
        if process.poll() is not None:
            return
        with suppress(ProcessLookupError):
            if hasattr(os, "killpg"):
                os.killpg(process.pid, number)
            else:
                process.kill()
        with suppress(subprocess.TimeoutExpired):
            process.wait(PATIENCE)


def main() -> None:
    """Make the folder and say its name; start the command that a line of stdin states, [command, environment]; wait for one of
    the two to end."""
    for number in ENDING:
        signal.signal(number, _leave)
    folder, process = Path(tempfile.mkdtemp(prefix="strainsight-")), None
    signalled = False
    try:
        print(folder, flush=True)
        line = sys.stdin.readline()
        if not line:
            return
        command, environment = json.loads(line)
        with open(folder / SAID, "wb") as output:
            process = subprocess.Popen(
                [*command, str(folder)],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        while process.poll() is None:
            if select.select([sys.stdin], [], [], LOOK)[0]:
                if (folder / END).exists():
                    with suppress(subprocess.TimeoutExpired):
                        process.wait(PATIENCE)
                return
        (folder / "ended").write_text(json.dumps(process.returncode))
        os.replace(folder / "ended", folder / ENDED)
        sys.stdin.read()
    except SystemExit:
        signalled = True
        raise
    finally:
        for number in ENDING:
            signal.signal(number, signal.SIG_IGN)
        if process is not None:
            _end(process, signalled)
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
