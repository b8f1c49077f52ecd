"""Alterations that know what a deck and a config are made of: fields swapped, cards doubled, ids changed, keys moved, units.

python -m tests.fuzz.structured [--inputs 3000] [--seed 1]: each through `import`, one in DEEP of what is taken through the stages
to `observe`.
"""

from __future__ import annotations

import argparse
import copy
import os
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import yaml

from strainsight.config.load import LoadedConfig, load_config
from strainsight.config.placement import PlacementConfig
from strainsight.errors import StrainsightError
from strainsight.experiment.structure.mesh import mesh_of
from strainsight.runner.plan import Job
from strainsight.runner.runner import run
from strainsight.stages.bench.pipeline import bench_stages
from strainsight.stages.import_mesh import looked_at
from strainsight.stages.placement import PLACEMENT

from ..edges.beam import BENCH_CONFIG, PLACEMENT_CONFIG
from ..edges.beam import bricks as beam
from ..wrong.decks import bar, config, frame, inp, msh, plate
from ..wrong.models import ABAQUS, OF_PLIES, ON_PLATE, of_gmsh, plies
from .guard import Hung, Watch, soon

DEEP = 8
"""One in so many of the models that are taken goes on."""
LAST = "observe"
UNITS = (1e3, 1e-3, 1e6, 1e-6, 1e9, 1e-9, 25.4, 0.0254, 9.81, 9810.0, -1.0, 0.0, 2, 2.0, 0.5, 3, 0.9, 1.1)
Sound = tuple[str, str, str]
"""Name of the deck, its text, the config."""


@cache
def sound() -> list[Sound]:
    """What is altered: solids, shells, laminates, beams and springs, of three formats, a rich config and a bench."""
    more = ("CONM2,50,5,,2.5", "CELAS2,60,1.+6,5,1", "FORCE,7,5,,10.,0.,0.,1.", "SET1,5,1,THRU,9", "PARAM,POST,-1")
    tied = ("GRID,99,,.5,0.,0.", "RBE2,98,99,123456,5,10,15,20", "GRAV,8,9,9.81,0.,0.,-1.")
    turned = "CORD2R,9,,0.,0.,0.,0.,0.,1.\n,1.,0.,0."
    related = ("MPC,1,3,3,1.,8,3,-1.", "RBE3,97,,98,123456,1.,123,4,9,\n,14", "GRID,98,9,.6,0.,0.")
    many = bar(*more, *tied, turned, *related, case="SPC = 1\nMPC = 1\nSET 3 = 1, 2")
    found = [("deck.bdf", many, config(load="deck_load: FORCE-7")), ("deck.bdf", bar(), config())]
    found += [("deck.bdf", plate("PLOAD4,9,1,5.", "PLOAD2,9,2.,2"), config(**ON_PLATE))]
    found += [("deck.bdf", plies("45.", "-45.", "0.", "90."), config(**OF_PLIES)), ("deck.bdf", frame(), config())]
    spring = "*ELEMENT, TYPE=SPRING1, ELSET=SP\n90, 5\n*SPRING, ELSET=SP\n3\n5."
    step = f"{spring}\n*STEP\n*CLOAD\n5, 3, 10.\n*DLOAD\nEALL, P1, 1.\n*END STEP"
    found += [("deck.inp", inp(more=step), config(**ABAQUS)), ("deck.msh", msh(), config(**of_gmsh()))]
    rich = yaml.safe_dump(PLACEMENT_CONFIG, sort_keys=False, allow_unicode=True)
    bench = yaml.safe_dump(BENCH_CONFIG, sort_keys=False, allow_unicode=True)
    deck = beam((4, 1, 1), "hex8")
    return [*found, ("beam.bdf", deck, rich), ("beam.bdf", deck, bench)]


def altered(own: Sound, rng: Random) -> Sound:
    name, deck, text = own
    for _ in range(rng.choice((1, 1, 2, 3))):
        if rng.random() < 0.55:
            deck = _deck(deck, name, rng)
        else:
            data = yaml.safe_load(text)
            _tree(data, rng)
            text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
    return name, deck, text


def _deck(text: str, name: str, rng: Random) -> str:
    """Rows of fields: cards of Nastran, data lines of Abaqus and gmsh."""
    sign = " " if name.endswith(".msh") else ","
    rows = [line.split(sign) for line in text.splitlines()]
    wide = [i for i, row in enumerate(rows) if len(row) > 1]
    i, j = rng.choice(wide), rng.choice(wide)
    alike = [k for k in wide if rows[k][0] == rows[i][0]]
    k = rng.choice(alike)
    way = rng.choices(range(11), [2, 2, 1, 2, 1, 2, 1, 4, 1, 2, 2])[0]
    a, b = rng.randrange(len(rows[i])), rng.randrange(len(rows[i]))
    if way == 0:  # two fields of a card
        rows[i][a], rows[i][b] = rows[i][b], rows[i][a]
    elif way == 1 and a < len(rows[k]):  # a field of two cards of a kind
        rows[i][a], rows[k][a] = rows[k][a], rows[i][a]
    elif way == 2:  # a card twice
        rows.insert(rng.choice(wide), list(rows[i]))
    elif way == 3:  # a card twice, with another id
        again = list(rows[i])
        again[min(1, len(again) - 1)] = str(rng.randrange(1, 2000))
        rows.insert(i + 1, again)
    elif way == 4:
        del rows[i]
    elif way == 5:  # the id of something else
        rows[i][a] = rng.choice([row[1] for row in (rows[w] for w in wide)])
    elif way == 6:
        rows[i][a] = ""
    elif way == 7:  # another unit, of a field of all cards of a kind
        factor = rng.choice(UNITS)
        for own in alike:
            if a < len(rows[own]):
                rows[own][a] = _scaled(rows[own][a], factor)
    elif way == 8:  # a card of another kind
        rows[i][0] = rows[j][0]
    elif way == 9:  # a card elsewhere
        rows.insert(rng.randrange(len(rows)), rows.pop(i))
    else:
        rows[i][a] = rng.choice(("-1", "0", "1", "123456", "3", "1.+30", "-1.", "1.-30", "THRU", "999999"))
    return "\n".join(sign.join(row) for row in rows) + "\n"


def _scaled(text: str, factor: float) -> str:
    try:
        value = factor * float(text)
    except ValueError:
        return text
    return f"{value:.9g}" if "." in f"{value:.9g}" or "e" in f"{value:.9g}" else f"{value:.9g}."


def _tree(data: Any, rng: Random) -> None:
    places = list(_places(data))
    (own, key), (other, name) = rng.choice(places), rng.choice(places)
    numbers = [(at, name) for at, name in places if isinstance(at[name], int | float) and not isinstance(at[name], bool)]
    way = rng.choices(range(8), [1, 1, 1, 1, 4, 4, 1, 1])[0]
    if way in (4, 5) and numbers:
        own, key = rng.choice(numbers)
    if way == 0:  # two values
        own[key], other[name] = copy.deepcopy(other[name]), copy.deepcopy(own[key])
    elif way == 1 and isinstance(own, dict):  # a key in another section
        sections = [at for at, _ in places if isinstance(at, dict)]
        rng.choice(sections)[key] = own.pop(key)
    elif way == 2:
        del own[key]
    elif way == 3:
        own[key] = [copy.deepcopy(own[key])] * rng.choice((1, 2, 5))
    elif way in (4, 5) and numbers:
        own[key] = own[key] * rng.choice(UNITS)
    elif way == 6 and isinstance(own, dict):  # the name of another key
        own[str(name)] = own.pop(key)
    else:
        own[key] = rng.choice((None, 0, -1, 1, 1e9, "x", "", [], {}, True, "none", "all", 2.5, str(own[key]), 10**7))


def _places(data: Any) -> list[tuple[Any, Any]]:
    keys = list(data) if isinstance(data, dict) else list(range(len(data))) if isinstance(data, list) else []
    return [(data, key) for key in keys] + [place for key in keys for place in _places(data[key])]


def case(seed: int, number: int) -> Sound:
    rng = Random(f"structured {seed} {number}")
    return altered(rng.choice(sound()), rng)


def fault_of(seed: int, number: int, folder: Path, watch: Watch) -> str | None:
    """What is wrong with how a case ends: another exception than the product's, ten seconds, something written elsewhere."""
    own = case(seed, number)
    shutil.rmtree(folder, ignore_errors=True)
    watch.found.clear()
    watch.on = True
    try:
        with soon(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            _through(_written(folder, own), folder, number % DEEP == 0)
    except StrainsightError as error:
        said = str(error)
        if not said.strip() or any(not sign.isprintable() and sign != "\n" for sign in said):
            return f"a message that cannot be printed: {said[:100]!r}"
    except MemoryError:
        pass  # said by the command line
    except Hung:
        return "over ten seconds"
    except Exception as error:
        place = [own for own in traceback.extract_tb(error.__traceback__) if "strainsight" in own.filename][-3:]
        where = " < ".join(f"{Path(own.filename).name}:{own.lineno}" for own in reversed(place))
        return f"{type(error).__name__} at {where}: {str(error)[:150]}"
    finally:
        watch.on = False
    return watch.found[0] if watch.found else None


def _written(folder: Path, own: Sound) -> LoadedConfig:
    name, deck, text = own
    folder.mkdir(parents=True)
    (folder / name).write_text(deck, encoding="utf-8")
    (folder / "own.yaml").write_text(text, encoding="utf-8")
    return load_config(folder / "own.yaml")


def _through(loaded: LoadedConfig, folder: Path, deep: bool) -> None:
    model = loaded.model
    if not isinstance(model, PlacementConfig):
        if loaded.data["kind"] == "bench":
            job = Job(loaded.data, folder, folder / "results", loaded.locate, loaded.model)
            for _ in run(bench_stages(loaded.data)[:1], job):
                pass
        return
    looked_at(model, mesh_of(model.mesh, folder / model.mesh.file, base=folder))
    if deep:
        job = Job(loaded.data, folder, folder / "results", loaded.locate, loaded.model)
        last = [stage.name for stage in PLACEMENT].index(LAST)
        for _ in run(PLACEMENT[: last + 1], job):
            pass


def faults(seed: int, first: int, last: int, work: Path, say: Callable[[str], None] = lambda _: None) -> dict[int, str]:
    """Number of a case → what is wrong with it. The sound models come first, and load what is loaded once."""
    for i, own in enumerate(sound()):
        _through(_written(work / f"sound{i}", own), work / f"sound{i}", i == 7)
    watch = Watch(work, (), anywhere=True, calls=("libmkl_rt",))  # PARDISO loads its own
    found = {}
    for number in range(first, last):
        if said := fault_of(seed, number, work / "case", watch):
            found[number] = said
            say(f"  {number}: {said}")
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=3000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args(arguments)
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as made:
        last = asked.first + asked.inputs
        found = faults(asked.seed, asked.first, last, Path(made), lambda said: print(said, flush=True))
    kinds = Counter(said.partition(": ")[0] for said in found.values())
    print(f"{asked.inputs} altered models in {time.monotonic() - begun:.0f} s ({os.times().user:.0f} s), {len(found)} faults")
    for kind, count in kinds.most_common():
        print(f"  {count} × {kind}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
