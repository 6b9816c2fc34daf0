import sys
from pathlib import Path

import pytest

from dpsearch.policies.observations import observation_size
from dpsearch.rollout import GymEngine, LaneEngine
from dpsearch.runs import EnvRecipe, RunError

TMAZE = "dpsearch.envs:dpsearch/TMaze-v0"


def test_an_environment_with_a_kernel_is_played_in_lanes() -> None:
    rollouts = EnvRecipe(TMAZE, {"corridor_length": 5}).rollouts(threads=2)
    assert isinstance(rollouts, LaneEngine)
    assert (rollouts.threads, rollouts.max_steps, rollouts.reward_threshold) == (2, 1000, 3.8)


def test_the_step_limit_that_an_environment_takes_as_an_argument_is_its_limit() -> None:
    assert EnvRecipe(TMAZE, {"max_episode_steps": 5000}).rollouts().max_steps == 5000


def test_any_other_environment_is_played_by_the_vector_engine() -> None:
    rollouts = EnvRecipe("CartPole-v1", max_episode_steps=50, reward_threshold=40.0).rollouts(num_envs=3)
    assert isinstance(rollouts, GymEngine)
    assert (rollouts.max_steps, rollouts.reward_threshold) == (50, 40.0)
    rollouts.close()


def test_components_of_the_observation_can_be_hidden() -> None:
    env = EnvRecipe("CartPole-v1", observe_only=[0, 2]).make("rgb_array")
    assert observation_size(env.observation_space) == 2
    assert env.render_mode == "rgb_array"
    env.close()


@pytest.mark.parametrize(
    ("recipe", "message"),
    [
        (EnvRecipe("Bogus-v0"), "cannot make environment 'Bogus-v0'"),
        (EnvRecipe("bogus.module:Bogus-v0"), "No module named 'bogus'"),
        (EnvRecipe(TMAZE, {"bogus": 1}), "bogus"),
        (EnvRecipe(TMAZE, {"corridor_length": 0}), "corridor_length"),
        (EnvRecipe("FrozenLake-v1", {"map_name": "foo"}), "'FrozenLake-v1': KeyError: 'foo'"),
        (EnvRecipe("CartPole-v1", observe_only=[]), "indices must be distinct"),
    ],
)
def test_what_cannot_be_made_is_refused(recipe: EnvRecipe, message: str) -> None:
    with pytest.raises(RunError, match=message):
        recipe.make()


def test_a_space_that_no_policy_can_handle_is_refused() -> None:
    with pytest.raises(RunError, match="is not supported"):
        EnvRecipe("tests.support.odd_envs:tests/Wordy-v0").rollouts()


def test_an_environment_may_be_registered_by_a_module_in_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "light_in_this_folder.py").write_text(
        "import gymnasium\ngymnasium.register('tests/Here-v0', 'tests.support.nasty_envs:Light')\n"
    )
    monkeypatch.setattr("sys.path", [place for place in sys.path if place not in ("", str(tmp_path))])
    recipe = EnvRecipe("light_in_this_folder:tests/Here-v0")
    with pytest.raises(RunError, match="No module named 'light_in_this_folder'"):
        recipe.make()
    monkeypatch.chdir(tmp_path)
    recipe.make().close()
