"""Process between strainsight and the MPI launcher: if either ends, it ends the other and removes the folder. An interrupted
run leaves at once, without further Python code (`strainsight_cli.failures`). Therefore this process creates and removes the
private folder; a closed stdin indicates that the parent has ended."""

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
"""Files of the folder: exit code of the launcher; permission to end by itself; output of the launcher and its processes."""
LOOK = 0.05
"""[s] between two checks of launcher and parent."""
PATIENCE = 5.0
"""[s] for a launcher to end its processes."""
ENDING = (signal.SIGTERM, signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGTERM))
KILL = getattr(signal, "SIGKILL", signal.SIGTERM)


def _leave(number: int, _: object) -> None:
    raise SystemExit(128 + number)


def _end(process: subprocess.Popen[bytes], signalled: bool) -> None:
    """End the launcher by SIGTERM, which it passes on to its processes. If this process was ended by a signal, the launcher has
    usually received it as well; a second one would interrupt its cleanup."""
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
    """Create the folder and print its name; start the command [command, environment] from stdin; wait for either process to
    end."""
    for number in ENDING:
        signal.signal(number, _leave)
    folder, process = Path(tempfile.mkdtemp(prefix="strainsight-")), None
    signalled = False
    try:
        print(folder, flush=True)
        if not (line := sys.stdin.readline()):
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
