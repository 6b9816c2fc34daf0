import re
import subprocess
import sys
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from dpsearch.algos.baselines import DEFAULTS, settings_of
from dpsearch.config import completed, compose
from dpsearch.help import page
from tests.support.application import ROOT, train

ENVS = sorted(path.stem for path in (ROOT / "configs" / "env").glob("*.yaml"))
ALGOS = sorted(path.stem for path in (ROOT / "configs" / "algo").glob("*.yaml"))
SETTING = re.compile(r"^  ([\w.]+)=(.*)\n((?: {6}.*\n?)*)", re.M)


@pytest.mark.parametrize("choices", [(f"algo={algo}",) for algo in ALGOS] + [(f"env={env}",) for env in ENVS])
def test_every_setting_has_a_meaning(choices: tuple[str, ...]) -> None:
    said = {name: meaning.strip() for name, _, meaning in SETTING.findall(page(choices))}
    config = completed(*compose(choices))
    sections = ("algo", "env", "policy", "rollout")
    settings = {str(name) for name in config if name not in sections}
    settings |= {f"{section}.{name}" for section in sections for name in config[section]}
    inner = {name for name in said if name.startswith("algo.baseline.")}
    assert set(said) - inner == settings
    assert ("algo.baseline.episodes" in inner) == (config.algo.get("baseline") == {"kind": "constant"})
    assert not [name for name, meaning in said.items() if len(meaning) < 5]


@pytest.mark.parametrize("kind", sorted(DEFAULTS))
def test_the_settings_of_the_chosen_baseline_are_listed_too(kind: str) -> None:
    found = SETTING.findall(page([f"algo.baseline.kind={kind}"]))
    said = {name: meaning.strip() for name, _, meaning in found if name.startswith("algo.baseline.")}
    assert set(said) == {f"algo.baseline.{name}" for name in settings_of(DEFAULTS[kind])}
    assert all(said.values())


def test_values_are_those_of_the_command_line() -> None:
    values = {name: value for name, value, _ in SETTING.findall(page(["algo=rpg", "env=track", "seed=7"]))}
    assert values["seed"] == "7"
    assert values["env.speed_profile"] == "[10.0,70.0,1800.0]"
    assert values["algo.gradient_length"] == "null"
    again = page(["env=track", *(f"{name}={value}" for name, value in values.items())])
    assert SETTING.findall(again) == SETTING.findall(page(["env=track", "seed=7"]))


def test_what_must_be_given_is_said_to() -> None:
    assert "  env.id=???  (must be given)\n" in page(["env=gym"])
    assert "  env.path=???  (must be given)\n" in page(["env=pomdp"])


@pytest.mark.parametrize("choices", ["", "env=torcs", "algo=lrwr env=pomdp", "experiment=poles_rpg", "algo=fem"])
def test_a_page_fits_a_terminal_of_80_columns(choices: str) -> None:
    assert max(len(line) for line in page(choices.split()).splitlines()) < 80


def test_the_choices_of_each_group_are_listed_and_the_present_one_is_marked() -> None:
    text = " ".join(page(["experiment=poles_one_unit"]).split())
    for group in ("algo", "env", "experiment", "tuned"):
        names = [path.stem for path in (ROOT / "configs" / group).glob("*.yaml")]
        assert all(re.search(rf"\W{name}\W", text) for name in names)
    for chosen in ("xnes", "double_pole_hidden", "poles_one_unit"):
        assert f"[{chosen}]" in text
    assert "schema" not in text


@pytest.mark.parametrize("flag", ["--help", "-h"])
def test_the_application_prints_the_page_and_does_no_more(flag: str, tmp_path: Path) -> None:
    outcome = train("algo=snes", "env=tiger", f"run_dir={tmp_path / 'run'}", flag)
    assert (outcome.code, outcome.err) == (0, "")
    assert "env.single=false" in outcome.out
    assert not (tmp_path / "run").exists()


def test_help_refuses_settings_out_of_range_in_one_line() -> None:
    outcome = train("algo.gamma=2", "--help")
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.err == "error: algo.gamma must be in (0, 1], got 2.0\n"


def test_help_refuses_what_the_application_would() -> None:
    outcome = train("env.corridor_lenght=3", "--help")
    assert outcome.code == 2
    assert outcome.err == "error: env.corridor_lenght is not a setting of env: did you mean corridor_length?\n"


def test_a_page_is_printed_by_the_command_itself() -> None:
    result = subprocess.run([sys.executable, "train.py", "--help"], cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 0
    assert result.stdout.startswith("python train.py [GROUP=CHOICE ...]")
    assert OmegaConf.load(ROOT / "configs" / "env" / "tmaze.yaml").id in result.stdout


def test_a_reader_that_has_seen_enough_may_close_the_page() -> None:
    process = subprocess.Popen(
        [sys.executable, "train.py", "--help"], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    assert process.stderr.read() == ""
    process.stderr.close()
    assert process.wait() == 0
