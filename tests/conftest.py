"""One thread for the linear algebra, set before any test imports numpy; the order of the tests; what they cost (`--times`)."""

from __future__ import annotations

import fcntl
import math
import os
import resource
import sys
import zlib
from collections import defaultdict
from pathlib import Path

import pytest

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

HERE = Path(__file__).parent
LONGEST = (
    "portability/test_portability.py",
    "test_manual.py",
    "stages/test_angle.py",
    "stages/test_estimate.py",
    "stages/test_campaign.py",
    "stages/test_accuracy.py",
)
"""Files of more than a minute and a half by `--times`, the longest first: one worker takes a file alone."""
SHARDS = 8
"""Parts into which the slow tests are divided, by file: CI runs one of them for each commit."""
START, END = "start-up", "end of session"
_spent = 0.0
"""[s] processor time of this process when the last phase of a test ended."""


@pytest.fixture(scope="session", autouse=True)
def sweeps_stay_here():
    """A worker of pytest-xdist has one core: a sweep by two more processes would take their start and imports on top, a second
    or two each, and the core of the other. Tests of such processes ask for them (`eager` in tests/parallel)."""
    from strainsight import parallel

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parallel, "WORTH", math.inf)
        yield


@pytest.fixture(scope="session", autouse=True)
def results_of_the_checkout_are_ignored():
    """What `make run` leaves in results/ changes no test: a command notes that the run of a config is there already."""
    from strainsight_cli import work

    look = work.elsewhere
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(work, "elsewhere", lambda own: "" if own.job.base.is_relative_to(HERE.parent) else look(own))
        yield


def pytest_addoption(parser):
    parser.addoption("--times", action="store_true", help="processor seconds of rooms, files and tests, in the end")
    parser.addoption("--shard", type=int, choices=range(1, SHARDS + 1), help=f"one of {SHARDS} parts of the slow tests")


def shard_of(path):
    """The shard of a test file, 1 to SHARDS, whatever other files there are."""
    return zlib.crc32(path.relative_to(HERE).as_posix().encode()) % SHARDS + 1


def pytest_collection_modifyitems(config, items):
    """With --shard, the slow tests of that shard alone. The longest files come first, then those with slow tests, so that no
    worker is left alone with one at the end."""
    shard = config.getoption("--shard")
    if shard is not None:
        selected = [item for item in items if item.get_closest_marker("slow") and shard_of(item.path) == shard]
        config.hook.pytest_deselected(items=[item for item in items if item not in set(selected)])
        items[:] = selected
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    first = {HERE / name: at for at, name in enumerate(LONGEST)}
    items.sort(key=lambda item: (first.get(item.path, len(first)), item.path not in slow))


def pytest_make_collect_report(collector):
    """One worker compiles a test file of a fresh clone; the others wait for it, and load what it has written."""
    if isinstance(collector, pytest.Module):
        path = collector.path
        if not any((path.parent / "__pycache__").glob(f"{path.stem}.*-pytest-*.pyc")):
            before = set(sys.modules)
            with path.open() as stream:
                fcntl.flock(stream, fcntl.LOCK_EX)
                try:
                    _ = collector.obj
                except (Exception, pytest.skip.Exception):  # collecting it raises that again, unless half a module is there
                    for name in set(sys.modules) - before:
                        if getattr(sys.modules[name], "__file__", None) == str(path):
                            del sys.modules[name]


def pytest_collection_finish(session):
    global _spent
    _spent = _processor()
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput[START] = _spent
    else:
        session.config.stash[_starts] = [_spent]


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_teardown(item, nextitem):
    item.stash[_last] = nextitem is None


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """What a phase of a test took goes into its report: children that have ended are counted with the phase they ended in.

    Those of fixtures of the session end after the last test of a worker, which has nothing to do with them."""
    global _spent
    report = yield
    now = _processor()
    report.processor, _spent = now - _spent, now
    report.ends = call.when == "teardown" and item.stash.get(_last, False)
    return report


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    node.config.stash.setdefault(_starts, []).append(getattr(node, "workeroutput", {}).get(START, 0.0))


_starts = pytest.StashKey[list]()
_last = pytest.StashKey[bool]()


def pytest_terminal_summary(terminalreporter, config):
    if not config.getoption("--times"):
        return
    spent, slow = defaultdict(float), set()
    for report in (report for reports in terminalreporter.stats.values() for report in reports):
        if hasattr(report, "processor"):
            spent[f"/{END}" if report.ends else report.nodeid] += report.processor
            slow |= {report.nodeid} if "slow" in report.keywords else set()
    rooms = defaultdict(lambda: [0, 0.0, 0, 0.0])
    for name, seconds in spent.items():
        room = name.split("::")[0].split("/")[1]
        for row in (rooms[room], rooms["all"]):
            for at in (0, 2)[: 1 + (name not in slow)]:
                row[at] += 1
                row[at + 1] += seconds
    say = terminalreporter.write_line
    terminalreporter.section("processor seconds")
    say(f"| {'room':16} | tests | seconds | fast tests | seconds |")
    say("|---|---|---|---|---|")
    for room in sorted(rooms, key=lambda room: (room == "all", room)):
        tests, seconds, fast, of_fast = rooms[room]
        say(f"| {room:16} | {tests:5} | {seconds:7.1f} | {fast:10} | {of_fast:7.1f} |")
    say(f"{START} of the workers: {', '.join(f'{seconds:.1f}' for seconds in config.stash.get(_starts, []))}")
    files = defaultdict(float)
    for name, seconds in spent.items():
        files[name.split("::")[0]] += seconds
    for name in sorted(files, key=files.__getitem__, reverse=True)[:40]:
        say(f"{files[name]:7.2f}      {name}")
    for name in sorted(spent, key=spent.__getitem__, reverse=True)[:40]:
        say(f"{spent[name]:7.2f} {'slow' if name in slow else '    '} {name}")


def _processor() -> float:
    """Processor time of this process and of its children that have ended [s]."""
    each = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(use.ru_utime + use.ru_stime for use in each)
