import re
from dataclasses import asdict
from inspect import signature
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from dpsearch.algos import ALGORITHMS, RPGConfig
from dpsearch.algos.baselines.constant import ConstantConfig
from dpsearch.algos.baselines.history import HistoryConfig
from dpsearch.config import TrainConfig, checked, completed, compose
from dpsearch.envs import TORCS, Tiger, Track
from dpsearch.options import options_of
from dpsearch.policies import PolicyConfig
from dpsearch.pomdp.task import TabularTask
from dpsearch.runs import EnvRecipe, RunError
from dpsearch.search import SEARCHES

CONFIGS = Path(__file__).parents[1] / "configs"


def composed(*overrides: str) -> TrainConfig:
    return checked(completed(*compose(overrides), overrides))


def test_the_default_is_the_thesis_s_way_to_learn_the_tmaze() -> None:
    config = composed()
    assert config.algo == RPGConfig()
    assert config.policy == PolicyConfig()
    kwargs = {"corridor_length": 10, "encoding": "bits", "max_episode_steps": None, "wrong_turn_reward": -0.1}
    assert config.env.recipe() == EnvRecipe("dpsearch.envs:dpsearch/TMaze-v0", kwargs)


def test_algorithms_take_the_discount_factor_of_the_task() -> None:
    assert composed("env.gamma=0.5").algo.gamma == 0.5
    assert composed("env.gamma=0.5", "algo.gamma=0.6").algo.gamma == 0.6


def test_any_gymnasium_environment_is_described_by_its_arguments() -> None:
    config = composed(
        "env=gym",
        "env.id=CartPole-v1",
        "env.kwargs.sutton_barto_reward=true",
        "env.observe_only=[0,2]",
        "env.max_episode_steps=50",
        "env.reward_threshold=45",
    )
    kwargs = {"sutton_barto_reward": True}
    assert config.env.recipe() == EnvRecipe("CartPole-v1", kwargs, [0, 2], 50, 45.0)


def test_rpg_has_settings_of_its_own_for_any_environment() -> None:
    anywhere = "env=gym", "env.id=CartPole-v1"
    assert (composed(*anywhere).algo.natural_step, composed(*anywhere, "algo.natural_step=0.1").algo.natural_step) == (
        0.01,
        0.1,
    )
    assert composed("algo=lrwr", *anywhere).policy.init_range == composed("algo=lrwr").policy.init_range


def test_options_of_an_optimizer_need_no_plus_sign() -> None:
    config = composed("algo.optimizer_options.momentum=0.9")
    assert config.algo.optimizer_options == {"momentum": 0.9}
    assert composed("algo=lrwr", "algo.optimizer_options={momentum: 0.9}").algo.optimizer_options == {"momentum": 0.9}


GYM = ("env=gym", "env.id=CartPole-v1")  # where RPG has a history baseline with five steps


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        (["algo.baseline=history"], HistoryConfig()),
        (["algo.baseline.kind=history", "algo.baseline.cells=8"], HistoryConfig(cells=8)),
        (["algo.baseline={kind: history, cells: 8}"], HistoryConfig(cells=8)),
        ([*GYM], HistoryConfig(steps=5)),
        ([*GYM, "algo.baseline=history"], HistoryConfig()),
        ([*GYM, "algo.baseline=history", "algo.baseline.cells=8"], HistoryConfig(cells=8)),
        ([*GYM, "algo.baseline.cells=8", "algo.baseline=history"], HistoryConfig(cells=8)),
        (
            ["algo.baseline=history", "algo.baseline.optimizer_options.amsgrad=true"],
            HistoryConfig(optimizer_options={"amsgrad": True}),
        ),
        ([*GYM, "algo.baseline.cells=8"], HistoryConfig(cells=8, steps=5)),
        ([*GYM, "algo.baseline.kind=constant"], ConstantConfig()),
        ([*GYM, "algo.baseline.kind=constant", "algo.baseline.episodes=9"], ConstantConfig(9)),
        ([*GYM, "algo.baseline={kind: constant, episodes: 9}"], ConstantConfig(9)),
    ],
)
def test_a_baseline_that_the_user_chooses_takes_no_settings_of_the_one_in_a_file(
    overrides: list[str], expected: object
) -> None:
    assert composed(*overrides).algo.baseline == expected


def test_the_default_baseline_takes_settings_without_its_kind() -> None:
    assert composed("algo.baseline.episodes=9").algo.baseline == ConstantConfig(9)


NO_SETTING = r"^algo\.baseline\.steps is no setting of the constant baseline, which takes episodes$"


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ([*GYM, "algo.baseline.kind=constant", "algo.baseline.steps=5"], NO_SETTING),
        ([*GYM, "algo.baseline.kind=constant", "algo.baseline={steps: 5}"], NO_SETTING),
        ([*GYM, "algo.baseline.kind=constant", "++algo.baseline.steps=5"], NO_SETTING),
        ([*GYM, "algo.baseline=constant", "algo.baseline.steps=5"], NO_SETTING),
        (["algo.baseline.kind=mean"], r"^algo\.baseline\.kind must be one of constant, .*, got 'mean'$"),
        (["algo.baseline=mean"], r"^algo\.baseline\.kind must be one of constant, .*, got 'mean'$"),
        (["algo.baseline.episodes=few"], r"^algo\.baseline\.episodes must be a whole number, 0 or more, got 'few'$"),
        (["algo.baseline.cells=8"], r"^algo\.baseline\.cells is no setting of the constant baseline, which takes epi"),
        (["algo.baseline_cells=8"], r"^algo\.baseline_cells is now algo\.baseline\.cells$"),
        (["+algo.baseline_cells=8"], r"^algo\.baseline_cells is now algo\.baseline\.cells$"),
        (["algo=lrwr", "algo.baseline_weight=1"], r"^algo\.baseline_weight is now algo\.baseline\.weight$"),
    ],
)
def test_a_setting_that_the_user_gives_and_the_baseline_does_not_take_is_refused(
    overrides: list[str], message: str
) -> None:
    with pytest.raises(RunError, match=message):
        composed(*overrides)


def test_a_setting_that_no_baseline_has_is_refused_from_files_too() -> None:
    config, choices = compose(())
    config.algo.baseline = {"kind": "constant", "cels": 8}
    with pytest.raises(RunError, match=r"^algo\.baseline\.cels is no setting of the constant baseline"):
        checked(completed(config, choices))


@pytest.mark.parametrize("name", ["SinglePole", "SinglePoleHidden", "DoublePole", "DoublePoleHidden"])
def test_every_task_of_balancing_poles_has_its_option(name: str) -> None:
    group = re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()
    config = composed(f"env={group}", "env.start_state=generalisation")
    kwargs = {"cart_friction": 0.0, "max_episode_steps": None, "reward": "steps", "start_state": "generalisation"}
    assert config.env.recipe() == EnvRecipe(f"dpsearch.envs:dpsearch/{name}-v0", kwargs)
    assert config.algo.gamma == 0.99
    recipe = composed(f"env={group}", "env.start_state=[0,0,0.1,0]").env.recipe()
    assert recipe.kwargs["start_state"] == [0, 0, 0.1, 0]


def test_the_track_is_described_by_its_arguments() -> None:
    config = composed("algo=fem", "env=track")  # which has no settings of its own there
    env = gym.make("dpsearch.envs:dpsearch/Track-v0").unwrapped
    assert isinstance(env, Track)
    kwargs = config.env.recipe().kwargs
    assert Track(**kwargs).task.rules == env.task.rules
    np.testing.assert_array_equal(Track(**kwargs).task.kernel.floats, env.task.kernel.floats)
    assert config.env.gamma == 0.99
    for given, expected in (("[30,60,100]", [30, 60, 100]), ("55", 55), ("null", None)):
        assert composed("env=track", f"env.speed_profile={given}").env.recipe().kwargs["speed_profile"] == expected
    segments = composed("env=track", "env.track=[[straight,500],[turn,120,180],[straight,500],[turn,120,180]]")
    np.testing.assert_array_equal(Track(**segments.env.recipe().kwargs).task.shape.x, Track("oval").task.shape.x)


def test_torcs_is_configured_as_its_class_is_by_default() -> None:
    recipe = composed("algo=fem", "env=torcs").env.recipe()  # which has no settings of its own there
    assert recipe.id == "dpsearch.envs:dpsearch/TORCS-v0"
    defaults = {name: argument.default for name, argument in signature(TORCS).parameters.items()}
    assert defaults.pop("render_mode") is None
    lists = {name: list(value) if isinstance(value, tuple) else value for name, value in defaults.items()}
    assert recipe.kwargs == lists


@pytest.mark.parametrize("algo", ["rpg", "cmaes", "xnes"])
def test_steering_is_learned_with_the_same_settings_in_both_simulators(algo: str) -> None:
    track, torcs = (composed(f"algo={algo}", f"env={env}") for env in ("track", "torcs"))
    assert asdict(track.algo) == asdict(torcs.algo)
    assert track.policy == torcs.policy
    for setting in ("track", "reward", "stuck_seconds", "speed_profile", "start"):
        assert track.env.recipe().kwargs[setting] == torcs.env.recipe().kwargs[setting]


def test_every_algorithm_has_a_file_and_every_file_an_algorithm() -> None:
    assert {path.stem for path in (CONFIGS / "algo").glob("*.yaml")} == set(ALGORITHMS)


@pytest.mark.parametrize("env", sorted(path.stem for path in (CONFIGS / "env").glob("*.yaml") if path.stem != "gym"))
def test_the_files_of_environments_repeat_no_default(env: str) -> None:
    said = OmegaConf.load(CONFIGS / "env" / f"{env}.yaml")
    assert isinstance(said, DictConfig)
    arguments = {option.name: option.default for option in EnvRecipe(said.id).options()}
    for name in set(said) - {"id", "gamma"}:
        assert OmegaConf.is_missing(said, str(name)) or said[name] != arguments[str(name)]


class Growling(Tiger):
    """A task with one more argument than the configuration files know of."""

    @classmethod
    def make_task(
        cls, single: bool = False, max_episode_steps: int | None = None, growls: int = 3, *, path: str | Path = "den"
    ) -> TabularTask:
        return super().make_task(single, max_episode_steps)


def test_a_new_argument_of_a_task_is_a_setting_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dpsearch.envs.tiger.Tiger", Growling)
    assert composed("env=tiger").env.recipe().kwargs["growls"] == 3
    assert composed("env=tiger", "env.growls=5").env.recipe().kwargs["growls"] == 5
    with pytest.raises(OmegaConfBaseException, match="could not be converted to Integer"):
        composed("env=tiger", "env.growls=often")
    with pytest.raises(RunError, match=r"^env\.growl is not a setting of env: did you mean growls\?$"):
        composed("env=tiger", "env.growl=5")
    assert composed("env=tiger").env.recipe().kwargs["path"] == str(Path("den").absolute())


def test_any_registered_class_can_have_a_file_of_its_own() -> None:
    """Without an argument for it, the step limit is Gymnasium's; what it is registered with is the default."""
    config = compose(["env=tiger"])[0]
    config.env = {"id": "CartPole-v1", "gamma": 0.9, "sutton_barto_reward": True, "max_episode_steps": 7}
    env = checked(completed(config, {"algo": "rpg", "env": "cart"})).env
    assert env.recipe() == EnvRecipe("CartPole-v1", {"sutton_barto_reward": True}, max_episode_steps=7)
    config.env = {"id": "FrozenLake-v1", "gamma": 0.9}
    assert checked(completed(config, {"algo": "rpg", "env": "lake"})).env.recipe().kwargs["map_name"] == "4x4"


@pytest.mark.parametrize("algo", sorted(SEARCHES))
def test_a_search_has_its_own_arguments_as_settings(algo: str) -> None:
    settings = composed(f"algo={algo}", "algo.patience=7").algo
    given = settings.search_options()
    assert given["patience"] == 7
    search = SEARCHES[algo](np.zeros(3), 1.0, **given)
    assert search.patience == 7
    usual = {option.name: option.default for option in options_of(SEARCHES[algo])}
    said = OmegaConf.select(OmegaConf.load(CONFIGS / "algo" / f"{algo}.yaml"), "algo") or {}
    changed = {"patience", "tolx", *said}
    assert {name: value for name, value in given.items() if name not in changed}.items() <= usual.items()
    assert not {"x0", "seed", "target", "max_evaluations", "diagonal"} & set(given)


def test_every_experiment_is_a_valid_configuration() -> None:
    for path in (CONFIGS / "experiment").glob("*.yaml"):
        composed(f"experiment={path.stem}")


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ("policy=5", "policy must be settings, got 5"),
        ("+policy.cor=lstm", r"policy\.cor is not a setting of policy: did you mean core\?"),
        ("+total_step=1", r"total_step is not a setting: did you mean total_steps\?"),
        ("env=pomdp", r"env\.path must be given"),
        ("env.id=Bogus-v0", "cannot make environment 'Bogus-v0': .*"),
        ("rollout.bogus=1", r"rollout\.bogus is not a setting of rollout: there are threads, .*"),
    ],
)
def test_what_is_no_setting_is_refused_by_its_full_name(overrides: str, message: str) -> None:
    with pytest.raises(RunError, match=f"^{message}$"):
        composed(*overrides.split())


def test_what_is_no_algorithm_is_refused() -> None:
    with pytest.raises(RunError, match=r"^algo must be one of rpg, .*, got bogus$"):
        completed(DictConfig({}), {"algo": "bogus", "env": "tmaze"})


def test_a_completed_configuration_says_every_setting_and_is_complete() -> None:
    config = completed(*compose(["algo=nes", "env=track"]))
    assert (config.env.width, config.algo.refresh_rate, config.policy.init_range) == (12.0, 0.01, 0.01)
    saved = OmegaConf.create(OmegaConf.to_yaml(config, resolve=True))
    assert isinstance(saved, DictConfig)
    again = checked(completed(saved, {"algo": "nes", "env": "track"}))
    assert asdict(again) == asdict(composed("algo=nes", "env=track"))
