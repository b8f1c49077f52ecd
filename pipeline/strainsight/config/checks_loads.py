"""What the fields of a load demand of each other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from strainsight.config.loads import Load, Recorded, signal_problems
from strainsight.config.problem import Problem, exactly_one


def load_problems(key: str, load: Load) -> Iterator[Problem]:
    places = {"node": load.node, "set": load.set, "deck_load": load.deck_load}
    of_mass = {"gravity": load.gravity, "rotation": load.rotation}
    if any(of_mass.values()):
        yield from _on_all_mass(key, load, of_mass, places)
        yield from _signal(key, load)
        return
    yield from exactly_one(key, places)
    if load.factor and load.deck_load is None:
        yield Problem(f"{key}.factor", "is of a load of the deck", "remove the key, or name a deck_load", at_key=True)
    kinds = {"moment": load.moment, "bearing": load.bearing, "pressure": load.pressure}
    if given := [name for name, value in kinds.items() if value is not None]:
        yield from _instead(key, load, given, kinds[given[0]])
    elif load.direction is None and load.deck_load is None:
        yield Problem(f"{key}.direction", "missing", "give a vector such as [0, 0, 1]", at_key=True)
    elif load.direction is not None and load.deck_load is not None:
        yield Problem(f"{key}.direction", "a load of the deck has its own direction", "remove the key", at_key=True)
    elif load.direction is not None and not any(load.direction):
        yield Problem(f"{key}.direction", "a direction of length zero", "give a vector such as [0, 0, 1]")
    yield from _signal(key, load)


def _on_all_mass(key: str, load: Load, of_mass: Mapping[str, object], places: Iterable[str]) -> Iterator[Problem]:
    """Gravity or a rotation, which acts everywhere."""
    kind, *others = [name for name, value in of_mass.items() if value is not None]
    rest = (*places, "direction", "moment", "bearing", "pressure", "factor")
    for name in (*others, *(name for name in rest if getattr(load, name) is not None)):
        yield Problem(f"{key}.{name}", f"a load with '{kind}', too", "remove one of the two keys", at_key=True)
    vector = load.gravity if load.rotation is None else load.rotation.axis
    if vector is not None and not any(vector):
        where = f"{key}.gravity" if load.rotation is None else f"{key}.rotation.axis"
        yield Problem(where, "a vector of length zero", "give a vector such as [0, 0, -1]")


def _signal(key: str, load: Load) -> Iterator[Problem]:
    yield from signal_problems(f"{key}.signal", load.signal)
    if not load.known and isinstance(load.signal, Recorded) and load.process_noise.frequency is None:
        yield Problem(
            f"{key}.process_noise",
            "an unknown load from a recorded signal needs a typical frequency",
            f"give {key}.process_noise.frequency [Hz]",
            at_key=True,
        )


def _instead(key: str, load: Load, given: Sequence[str], value: object) -> Iterator[Problem]:
    """What stands instead of a direction."""
    kind = given[0]
    if len(given) > 1:
        yield Problem(f"{key}.{given[1]}", f"a load with '{kind}', too", "remove one of the two keys", at_key=True)
    if load.deck_load is not None:
        what = "a load of the deck is no moment" if kind == "moment" else "a load of the deck has its own forces"
        yield Problem(f"{key}.{kind}", what, "remove the key", at_key=True)
    elif load.direction is not None:
        own = {"moment": "a moment has an axis", "bearing": "a bearing load has a vector of its own"}
        what = f"{own.get(kind, 'a pressure acts inward')} and no direction"
        yield Problem(f"{key}.direction", what, "remove one of the two keys", at_key=True)
    if isinstance(value, tuple) and not any(value):
        yield Problem(f"{key}.{kind}", "an axis of length zero", "give a vector such as [0, 0, 1]")
    if kind != "moment" and load.set is None:
        yield Problem(f"{key}.{kind}", "acts on a face", "give `set` the name of one of mesh.faces", at_key=True)
