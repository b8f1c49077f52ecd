"""A stage needs only the sections that it and the stages before it read."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight.config.placement import STAGES, later_sections, sections_from_stage
from strainsight.errors import ConfigError
from strainsight.stages.placement import stages_for
from strainsight_cli.main import app

from ..edges.beam import PLACEMENT_CONFIG, TIP, bricks

MODEL = {key: PLACEMENT_CONFIG[key] for key in ("kind", "name", "mesh")}


@pytest.fixture
def beam(tmp_path, monkeypatch):
    """Write the config; call it with the arguments of a command."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "beam.bdf").write_text(bricks((4, 1, 1)))

    def call(config, *words):
        (tmp_path / "beam.yaml").write_text(config if isinstance(config, str) else yaml.safe_dump(config, sort_keys=False))
        return CliRunner().invoke(app, [*words])

    return call


def test_stages_read_no_section_that_they_do_not_need():
    """Import checks the loads and candidates that the config has."""
    stages = stages_for(True, "perturbed")
    assert {stage.name for stage in stages} == {*STAGES}
    for stage in stages:
        read = {key.split(".")[0] for key in stage.reads} & later_sections(stage.name)
        assert read == ({"loads", "gauges"} if stage.name == "import" else set()), stage.name


def test_import_modes_and_check_modes_need_the_mesh_alone(beam):
    modes = beam(MODEL, "modes", "beam.yaml")
    assert modes.exit_code == 0, modes.output
    frequency = [line.split()[1] for line in modes.output.splitlines() if line.startswith(("1 ", "2 "))]
    with open("modes.dat", "w", encoding="ascii") as file:  # of CalculiX: mode, eigenvalue, [rad/s], [Hz], imaginary part
        file.write("     E I G E N V A L U E   O U T P U T\n\n MODE NO    EIGENVALUE                       FREQUENCY\n\n")
        for number, hertz in enumerate(frequency, start=1):
            omega = 2 * 3.141592653589793 * float(hertz)
            file.write(f"{number:7d}{omega**2:14.7E}{omega:14.7E}{float(hertz):14.7E}{0:14.7E}\n")
    compared = beam(MODEL, "check-modes", "beam.yaml", "modes.dat")
    assert (compared.exit_code, "2 modes of the file and of the deck agree" in compared.output) == (0, True), compared.output


@pytest.mark.parametrize("stage", ["rom", "train", "validate"])
def test_later_stage_names_every_missing_section_with_an_example(beam, stage):
    missing = sections_from_stage().keys() - later_sections(stage)
    done = beam(MODEL, stage, "beam.yaml")
    assert done.exit_code == 2
    for section in missing:
        first, example = sections_from_stage()[section]
        assert f"{section}: the section is missing; the stage `{first}` needs it" in done.stderr
        assert f"add it, for example {section}: {example}" in done.stderr
    assert done.stderr.count("the section is missing") == len(missing)


def test_examples_of_sections_make_a_valid_config(beam):
    examples = {key: yaml.safe_load(example) for key, (_, example) in sections_from_stage().items()}
    examples["loads"]["force"]["node"] = TIP
    done = beam(MODEL | examples, "screen", "beam.yaml")
    assert done.exit_code == 0, done.output + done.stderr
    assert load_config("beam.yaml").model.place.keep == 4


def test_checks_of_present_sections_remain(beam):
    done = beam(MODEL | {"train": {"duration": 1.0, "time_step": 0.5}}, "rom", "beam.yaml")
    assert "loads: the section is missing" in done.stderr
    one = {"loads": PLACEMENT_CONFIG["loads"], "train": {"duration": 1.0, "time_step": 0.05}}
    done = beam(MODEL | one, "import", "beam.yaml")
    assert (done.exit_code, "the shortest period of load 'tip' (20 Hz)" in done.stderr) == (2, True)


def test_blank_lines_of_later_sections_are_reported_at_once_and_do_not_stop_import(beam):
    text = yaml.safe_dump(PLACEMENT_CONFIG, sort_keys=False)
    text = text.replace(f"node: {TIP}", "node:").replace("amplitude: 1000.0", "amplitude:").replace("keep: 2", "keep:")
    done = beam(text, "import", "beam.yaml")
    assert done.exit_code == 0, done.stderr
    assert "loads: the section has blank lines; `import` does not need it." in done.stderr
    assert "place: the section has blank lines" in done.stderr
    with pytest.raises(ConfigError) as caught:
        load_config("beam.yaml")
    keys = {problem.key for problem in (caught.value, *caught.value.others)}
    assert keys == {"loads.tip.node", "loads.tip.signal.amplitude", "place.keep"}
    wrong = beam(text.replace("known: true", "known: maybe"), "rom", "beam.yaml")
    assert (wrong.exit_code, "loads.tip.known: the value is 'maybe'" in wrong.stderr) == (2, True)


def test_without_validation_there_is_a_page_with_the_expected_accuracy(beam):
    config = {key: section for key, section in PLACEMENT_CONFIG.items() if key != "validate"}
    done = beam(config, "run", "beam.yaml", "--quiet")
    assert done.exit_code == 0, done.output
    results = Path("results", config["name"])
    page = (results / "report.html").read_text()
    assert "The estimates were not validated" in page
    assert "(expected σ)" in page
    assert not (results / "validate.h5").exists()
    test = {"file": "test.csv", "channels": [{"gauge": "G1", "channel": "1", "unit": "m/m"}]}
    done = beam(config | {"estimate": test}, "estimate", "beam.yaml")
    assert (done.exit_code, "estimate.initial_std: the initial standard deviation of" in done.stderr) == (2, True)
