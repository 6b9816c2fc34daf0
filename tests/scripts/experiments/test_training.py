from dataclasses import dataclass, replace

import pytest

from dpsearch.algos import RPG, RPGConfig
from scripts.experiments.training import compose

TINY = ("algo=rpg", "env=tmaze", "env.corridor_length=1")


def test_the_settings_are_those_of_the_configuration_files() -> None:
    settings = compose((*TINY, "policy.core=rnn", "algo.batch_size=7"))
    assert settings.algo == "rpg"
    assert settings.network == "Elman, 10 units"
    algorithm = settings.algorithm(settings.rollouts(), seed=5)
    assert isinstance(algorithm, RPG)
    assert (algorithm.config.batch_size, algorithm.seed, algorithm.policy.core_type) == (7, 5, "rnn")


def test_a_fingerprint_tells_settings_apart_but_not_where_the_run_is_kept() -> None:
    first = compose(TINY).fingerprint()
    assert compose((*TINY, "seed=3", "run_dir=elsewhere", "progress=false")).fingerprint() == first
    others = ("algo.batch_size=7", "policy.core=rnn", "env.encoding=one_hot", "total_steps=9")
    assert len({first, *(compose((*TINY, other)).fingerprint() for other in others)}) == 5


def test_a_setting_that_is_new_changes_no_fingerprint_until_it_is_given() -> None:
    @dataclass
    class Longer(RPGConfig):
        patience: int = 3

    settings = compose((*TINY, "algo.baseline.kind=history"))
    given = vars(settings.config.algo)

    def fingerprint(algo: Longer) -> str:
        return replace(settings, config=replace(settings.config, algo=algo)).fingerprint()

    assert fingerprint(Longer(**given)) == settings.fingerprint()
    assert fingerprint(Longer(**{**given, "patience": 4})) != settings.fingerprint()


@pytest.mark.parametrize("other", ["algo.baseline.kind=shared", "algo.baseline.cells=8", "algo.batch_size=21"])
def test_a_fingerprint_tells_baselines_and_their_settings_apart(other: str) -> None:
    history = (*TINY, "algo.baseline.kind=history")
    assert compose((*history, other)).fingerprint() != compose(history).fingerprint()
