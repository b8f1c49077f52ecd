"""Forty mistakes of a first day, as changes of the example `test`: what is refused, where, and what to do instead."""

from __future__ import annotations

TIMES = [0.001 * i for i in range(401)]
BONDED = "gauge,position_x,position_y,position_z,direction_x,direction_y,direction_z"
MODULUS = "parameters: {{E: {{property: youngs_modulus, region: {region}, guess: {guess}, range: [{range}]}}}}\nloads:"
SIGNAL = "{type: sweep, start_frequency: 5.0, end_frequency: 60.0, duration: 0.4, amplitude: 5.0e+3}"
G1 = "{channel: G1, gauge: root, unit: um/m}"
OF_LAYOUT = ("fixed_file: bonded.csv", "surface: all")


def table(head: str, value: float, delimiter: str = ",", decimal: str = ".", times: int = 401) -> str:
    """A record whose channels are all one ramp."""
    columns = head.splitlines()[0].count(delimiter)
    rows = [[f"{t:.3f}", *[f"{value * t:.4f}"] * columns] for t in TIMES[:times]]
    return "\n".join([head, *(delimiter.join(cell.replace(".", decimal) for cell in row) for row in rows)]) + "\n"


def modulus(guess: str, limits: str, region: int = 1) -> tuple[str, str]:
    return "loads:", MODULUS.format(region=region, guess=guess, range=limits)


def history(**changed: str) -> tuple[str, str]:
    keys = {"file": "f.csv", "time_column": "t", "value_column": "F", **changed}
    return SIGNAL, f"{{type: csv, {', '.join(f'{key}: {value}' for key, value in keys.items())}}}"


CATMAN = "CATMAN AP 5.3\nDatum: 01.02.2026\n\n" + table("time\tG1\tG2\tG3\tG4", 1.0, "\t")
RECORD = "time,G1,G2,G3,G4"
BARE = {"test.csv": table(RECORD, 300.0)}
HISTORY = {"f.csv": table("t [s],F [N]", 5.0)}

CONFIG = {
    "a misspelt section": ([("train:", "trian:")], "test.yaml:14:1  trian: unknown key", "did you mean train?"),
    "a version": (
        [("seed: 1", "seed: 1\nversion: 1")],
        "test.yaml:5:1  version: unknown key",
        "known here: kind, name,",
    ),
    "a misspelt kind": ([("kind: placement", "kind: placment")], "test.yaml:2:7  kind: ", "did you mean placement?"),
    "a name with a space": (
        [("name: test", "name: my test")],
        "test.yaml:3:1  name: 'my test'",
        "letters, digits, - and _",
    ),
    "a decimal comma in braces": (
        [("ratio: 0.01", "ratio: 0,01")],
        "test.yaml:13:10  damping: ',01'",
        "decimal point, as in 0.01",
    ),
    "a decimal comma": (
        [("train: {duration: 0.4,", "train: {duration: '0,4',")],
        "train.duration: '0,4'",
        "decimal point: 0.4",
    ),
    "a unit in a number": (
        [("train: {duration: 0.4,", "train: {duration: 0.4 s,")],
        "train.duration: '0.4 s'",
        "without its unit",
    ),
    "per cent": ([("ratio: 0.01", "ratio: 2 %")], "test.yaml:13:31  damping.ratio: '2 %'", "without its unit"),
    "no for false": ([("known: false", "known: no")], "test.yaml:10:12  loads.tip.known: 'no'", "write false"),
    "a tab": ([("  tip:", "\ttip:")], "test.yaml:7:1  not valid YAML", "with spaces, not with tabs"),
    "a key twice": ([("seed: 1", "seed: 1\nseed: 2")], "test.yaml:5:1  seed: given twice", "remove one of them"),
    "no space behind a colon": ([("seed: 1", "seed:1")], "test.yaml:5:1  not valid YAML", "a space behind the colon"),
    "a lost indent": (
        [("    node: 2", "   node: 2")],
        "test.yaml:9:14  not valid YAML",
        "indent it exactly as its neighbours",
    ),
    "a path of Windows": (
        [("file: cantilever.bdf", r'file: "C:\models\cantilever.bdf"')],
        "test.yaml:5:18  not valid YAML",
        "in single quotes",
    ),
    "a unit of length": (
        [("length_unit: m,", "length_unit: meter,")],
        "mesh.length_unit: 'meter' is not one of m, mm, cm",
        "Unit of length",
    ),
    "an axis by its letter": (
        [("[0, 0, 1]", "z")],
        "test.yaml:9:16  loads.tip.direction",
        "Direction in global coordinates",
    ),
    "no direction": ([("[0, 0, 1]", "[0, 0, 0]")], "test.yaml:9:16  loads.tip.direction", "such as [0, 0, 1]"),
    "a coarse step": (
        [("time_step: 1.0e-3}", "time_step: 1.0e-2}")],
        "train.time_step: 0.01 s gives 1.67 steps",
        "at most 0.00208 s",
    ),
    "more than the pool": ([("keep: 4", "keep: 400")], "test.yaml:20:32  place.keep: 400", "keep at most 100"),
    "an unknown that is none": ([("[tip]", "[tipp]")], "test.yaml:20:20  place.estimate[0]", "did you mean tip?"),
    "a known unknown": ([("known: false", "known: true")], "place.estimate[0]: load 'tip' is known", "known: false"),
    "noise in um/m": ([("value: 2.0e-6", "value: 2.0")], "gauges.noise_std.value: 2 m/m", "2 um/m are 2.0e-06"),
    "a guess out of its range": (
        [modulus("2.1e11", "1e11, 2e11")],
        "parameters.E.guess: 2.1e+11",
        "widen parameters.E.range",
    ),
}
"""What the config alone shows."""
DECK = {
    "no such deck": (
        [("cantilever.bdf", "cantilver.bdf")],
        "mesh.file: no such file: cantilver.bdf",
        "folder of the config",
    ),
    "no such node": ([("node: 2", "node: 9999")], "test.yaml:7:3  loads.tip: ", "ids of the mesh file"),
    "no such region": (
        [modulus("2.1e11", "1e11, 3e11", 3)],
        "parameters.E.region: the mesh has no region 3",
        "PSOLID 1",
    ),
    "E in MPa": (
        [modulus("210000", "180000, 240000")],
        "parameters.E.guess: the guess of E is 2.1e+05",
        "210000 MPa are 2.1e+11 Pa",
    ),
}
"""What the deck contradicts, at the import."""
FILES = {
    "decimals of Germany": (
        [],
        {"test.csv": table(RECORD.replace(",", ";"), 1.0, ";", ",")},
        "test.csv:2  estimate.file: '0,000' under 'time'",
        'estimate.text.decimal: ","',
    ),
    "the head of catman": ([], {"test.csv": CATMAN}, "test.csv:1  estimate.file: ", "`estimate.text.header_line: 4`"),
    "a spreadsheet": (
        [("test.csv", "test.xlsx")],
        {"test.xlsx": "PK"},
        "test.xlsx  estimate.file",
        "save the table as CSV",
    ),
    "a time in ms": (
        [],
        {"test.csv": table("time [ms],G1,G2,G3,G4", 1.0)},
        "stated in s, the file has it in ms",
        "`time: {unit: ms}`",
    ),
    "a channel that is not there": (
        [("channel: G3,", "channel: G33,")],
        {},
        "test.csv:1  estimate.channels.2.channel: no column 'G33'",
        "did you mean G3?",
    ),
    "a time that is not there": (
        [("{channel: time}", "{channel: t}")],
        {},
        "estimate.time.channel: no column 't'",
        "'time', 'G1'",
    ),
    "a channel twice": (
        [("channel: G3,", "channel: G2,")],
        {},
        "estimate.channels.2.channel: channel 'G2'",
        "check both",
    ),
    "a misspelt gauge": (
        [("below,", "bellow,")],
        {},
        "test.yaml:32:28  estimate.channels.2.gauge",
        "did you mean below?",
    ),
    "G5 of four": (
        [OF_LAYOUT, ("gauge: root", "gauge: G5")],
        {},
        "test.yaml:30:28  estimate.channels.0.gauge: no gauge 'G5'",
        "did you mean G4? there are G1, G2, G3, G4",
    ),
    "G3 was not bonded": (
        [OF_LAYOUT, ("gauge: root", "gauge: G3"), ("  file: test.csv", "  file: test.csv\n  gauges_file: g.csv")],
        {"g.csv": f"{BONDED}\nG1,0,0,0,1,0,0\nG4,1,0,0,1,0,0\n"},
        "estimate.channels.0.gauge: estimate.gauges_file does not say where G3 was bonded",
        "did you mean G4? it has G1, G4",
    ),
    "nobody knows where G1 was": (
        [OF_LAYOUT, ("gauge: root", "gauge: G1")],
        {},
        "estimate.gauges_file: G1 is the name of a place in the layout as it is now",
        "estimate.gauges_file: gauges.csv",
    ),
    "a file of gauges that is not there": (
        [("bonded.csv", "bondd.csv")],
        {},
        "gauges.fixed_file: no such file",
        "folder of the config",
    ),
    "columns of gauges": (
        [],
        {"bonded.csv": "gauge,x,y,z\nroot,1,2,3\n"},
        "bonded.csv:1  gauges.fixed_file: no column",
        BONDED,
    ),
    "um/m read as strain, said by the file": (
        [(G1, G1.replace("um/m", "m/m"))],
        {},
        "stated in m/m, the file has it in um/m",
        "stated unit",
    ),
    "um/m read as strain": (
        [(G1, G1.replace("um/m", "strain"))],
        BARE,
        "estimate.channels.0.unit: G1 reads up to 120 m/m, which is 12000 %",
        "are the readings in um/m?",
    ),
    "a gauge in N": (
        [(G1, G1.replace("um/m", "N"))],
        BARE,
        "estimate.channels.0.unit: the channel is in N",
        "check the unit",
    ),
    "a misspelt unit": (
        [(G1, G1.replace("um/m", "microstrains"))],
        {},
        "unknown unit 'microstrains'",
        "did you mean microstrain?",
    ),
    "mV/V without a bridge": (
        [(G1, G1.replace("um/m", "mV/V"))],
        BARE,
        "estimate.channels.0: a channel in mV/V",
        "gauge factor",
    ),
    "a known load without a channel": (
        [
            modulus("2.1e11", "1e11, 3e11"),
            ("known: false", "known: true"),
            ("[tip]", "[E]"),
            ("std: {tip: 1.0}", "std: {E: 0.1}"),
        ],
        {},
        "estimate.inputs: the known load 'tip' has no channel",
        "inputs: {tip: {channel: …, unit: N}}",
    ),
    "a history that is not there": (
        [history()],
        {},
        "loads.tip.signal.file: no such file",
        "folder of the config file",
    ),
    "a column of a history": (
        [history(value_column="Fz")],
        HISTORY,
        "f.csv:1  loads.tip.signal.value_column: no column 'Fz'",
        "did you mean F?",
    ),
    "a history that is short": (
        [history()],
        {"f.csv": table("t [s],F [N]", 5.0, times=300)},
        "loads.tip.signal.file: f.csv covers 0 to 0.299 s, train.duration asks for 0 to 0.4 s",
        "give train.duration at most 0.299 s",
    ),
    "a history in mm": (
        [history()],
        {"f.csv": table("t [s],F [mm]", 5.0)},
        "loads.tip.signal: 'F' is in mm",
        "column of the load",
    ),
    "a gap in a history": (
        [history()],
        {"f.csv": HISTORY["f.csv"].replace("0.100,0.5000", "0.100,")},
        "f.csv:102  loads.tip.signal",
        "no gaps",
    ),
}
"""What the files contradict, before the import."""
WORDS = {
    "a record from here": (
        ["estimate", "test.yaml", "--measurements", "data/run1.csv"],
        "data/run1.csv  --measurements",
        "folder that you are in",
    ),
    "a misspelt override": (
        ["run", "test.yaml", "--set", "place.kep=3"],
        "--set place.kep  place.kep",
        "did you mean keep?",
    ),
    "half an override": (
        ["run", "test.yaml", "--set", "place.keep"],
        "--set  'place.keep' is not KEY=VALUE",
        "--set place.keep=6",
    ),
    "a deck for a config": (
        ["run", "cantilever.bdf"],
        "cantilever.bdf  larger than 128 KiB",
        "give a config, not a deck",
    ),
    "a misspelt config": (["run", "tset.yaml"], "tset.yaml  no such config file", "strainsight init DECK writes one"),
    "a config for a deck": (["init", "test.yaml"], "test.yaml  a config, not a deck", "strainsight run test.yaml"),
}
"""What the command line says by itself."""
