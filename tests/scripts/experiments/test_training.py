from dpsearch.algos import RPG
from scripts.experiments.training import compose

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


def test_runs_that_were_logged_before_a_setting_existed_are_found() -> None:
    long = ("algo=rpg", "env=tmaze", "env.corridor_length=10", "total_steps=20000000")
    assert compose(long).fingerprint() == "7b1cb480862f55aa"
    assert (
        compose(
            (
                *long,
                "policy.readout=false",
            )
        ).fingerprint()
        != compose(long).fingerprint()
    )
