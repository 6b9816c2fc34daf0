import json
import shlex
from argparse import ArgumentParser
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, make_dataclass
from pathlib import Path
from typing import Any

import pytest
from numpy.typing import ArrayLike
from omegaconf import OmegaConf

from dpsearch.algos import ALGORITHMS, RPG, LRWRConfig, RPGConfig
from dpsearch.algos.baselines import DEFAULTS
from dpsearch.algos.policy_search import config_of
from dpsearch.config import env_config
from dpsearch.envs import Tiger
from dpsearch.policies import PolicyConfig
from dpsearch.pomdp.task import TabularTask
from dpsearch.search import XNES
from scripts.experiments import EXPERIMENTS
from scripts.experiments.experiment import Experiment
from scripts.experiments.jobs import RunLog
from scripts.experiments.training import compose, differences
from tests.support.application import ROOT

TINY = ("algo=rpg", "env=tmaze", "env.corridor_length=1")


def test_the_settings_are_those_of_the_configuration_files() -> None:
    settings = compose((*TINY, "policy.core=elman", "algo.batch_size=7"))
    assert settings.algo == "rpg"
    assert settings.network == "Elman, 10 units"
    algorithm = settings.algorithm(settings.rollouts(), seed=5)
    assert isinstance(algorithm, RPG)
    assert (algorithm.config.batch_size, algorithm.seed, algorithm.policy.config()["core"]) == (7, 5, "elman")


def test_a_fingerprint_tells_settings_apart_but_not_where_the_run_is_kept() -> None:
    first = compose(TINY).fingerprint()
    assert compose((*TINY, "seed=3", "run_dir=elsewhere", "progress=false")).fingerprint() == first
    others = ("algo.batch_size=7", "policy.core=elman", "env.encoding=one_hot", "total_steps=9")
    assert len({first, *(compose((*TINY, other)).fingerprint() for other in others)}) == 5


@pytest.fixture
def composed_anew() -> Iterator[None]:
    """Settings are composed once; a test that changes what there is to compose forgets them before and after."""
    compose.cache_clear()
    yield
    compose.cache_clear()


def wider(kind: type[Any]) -> type[Any]:
    """A dataclass with one more setting."""
    return make_dataclass(kind.__name__, [("fresh", float, field(default=0.5))], bases=(kind,))


class WiderTiger(Tiger):
    @classmethod
    def make_task(cls, single: bool = False, max_episode_steps: int | None = None, fresh: float = 0.5) -> TabularTask:
        return super().make_task(single, max_episode_steps)


class WiderXNES(XNES):
    def __init__(self, x0: ArrayLike, sigma0: ArrayLike, *, fresh: float = 0.5, **options: Any) -> None:
        super().__init__(x0, sigma0, **options)


@pytest.mark.parametrize(
    ("overrides", "place", "replacement", "section"),
    [
        (("algo=rpg", "algo.batch_size=7"), "dpsearch.algos.RPG.config_type", wider(RPGConfig), "algo"),
        (("algo=lrwr", "algo.batch_size=7"), "dpsearch.algos.LRWR.config_type", wider(LRWRConfig), "algo"),
        (("algo=xnes", "algo.patience=7"), "dpsearch.algos.XNESPolicySearch.config_type", config_of(WiderXNES), "algo"),
        (("env=tiger", "env.single=true"), "dpsearch.envs.tiger.Tiger", WiderTiger, "env"),
    ],
)
@pytest.mark.usefixtures("composed_anew")
def test_a_new_setting_changes_a_fingerprint_only_where_it_is_used(
    monkeypatch: pytest.MonkeyPatch, overrides: tuple[str, ...], place: str, replacement: type[Any], section: str
) -> None:
    before = compose(overrides).fingerprint()
    compose.cache_clear()
    monkeypatch.setattr(place, replacement)
    assert compose(overrides).fingerprint() == compose((*overrides, f"{section}.fresh=0.5")).fingerprint() == before
    assert compose((*overrides, f"{section}.fresh=0.25")).fingerprint() != before


def test_differences_are_those_from_the_defaults_in_code() -> None:
    @dataclass
    class Kind:
        kind: str = field(default="sort", init=False)
        size: int = 3

    @dataclass
    class Whole:
        given: str = "???"
        part: Kind = field(default_factory=Kind)
        numbers: list[int] = field(default_factory=lambda: [1])

    assert differences(Whole("x")) == {"given": "x"}
    assert differences(Whole("x", Kind(size=4), [1, 2])) == {
        "given": "x",
        "part": {"kind": "sort", "size": 4},
        "numbers": [1, 2],
    }


def defaults() -> dict[str, dict[str, Any]]:
    """The defaults of all settings that an outcome depends on, by algorithm and environment."""
    found = {name: asdict(kind.config_type()) for name, kind in ALGORITHMS.items()}
    for settings in found.values():
        if "baseline" in settings:  # its own settings are those of its kind
            settings["baseline"] = settings["baseline"]["kind"]
    found |= {f"baseline {kind}": asdict(settings) for kind, settings in DEFAULTS.items()}
    found["policy"] = asdict(PolicyConfig())
    for path in sorted((ROOT / "configs" / "env").glob("*.yaml")):
        if path.stem != "gym":
            found[path.stem] = asdict(env_config(OmegaConf.select(OmegaConf.load(path), "id"))())
    return found


def test_no_default_that_logged_runs_had_has_changed() -> None:
    """They would be taken for runs with the new one: give it in configuration files, or run again what is logged."""
    logged = json.loads(Path(__file__).with_name("logged_defaults.json").read_text())
    present = json.loads(json.dumps(defaults()))
    for name, settings in logged.items():
        still = {setting: present[name][setting] for setting in settings if setting in present[name]}
        assert still == {setting: value for setting, value in settings.items() if setting in still}


@pytest.mark.parametrize("name", ["table_3_1", "fig_3_4", "table_4_2", "table_7_2", "table_7_3", "tmaze_long"])
def test_the_runs_behind_a_published_table_are_found_in_its_log(name: str) -> None:
    experiment = EXPERIMENTS[name]
    assert isinstance(experiment, Experiment)
    parser = ArgumentParser()
    experiment.add_options(parser)
    published = json.loads((ROOT / "docs" / "results" / f"{name}.json").read_text())
    shown = {(row["task"], row["method"]) for row in published["rows"]}  # a method may be newer than the table
    cells = experiment.cells(parser.parse_known_args(shlex.split(published["command"]))[0])
    cells = [cell for cell in cells if (cell.task, cell.method.label) in shown]
    assert cells
    log = RunLog(ROOT / "docs" / "results" / f"{experiment.log or name}.runs.jsonl")
    known = log.path.read_text()  # a method that came later may have no runs yet
    first = [job for cell in cells if f'"{cell.method.name}"' in known for job in cell.jobs(experiment.run, [0])]
    assert first
    assert [(job.task, job.method) for job in first if job not in log.find(first)] == []


@pytest.mark.parametrize("other", ["algo.baseline.kind=shared", "algo.baseline.cells=8", "algo.batch_size=21"])
def test_a_fingerprint_tells_baselines_and_their_settings_apart(other: str) -> None:
    history = (*TINY, "algo.baseline.kind=history")
    assert compose((*history, other)).fingerprint() != compose(history).fingerprint()
