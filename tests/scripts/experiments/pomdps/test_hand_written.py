from pathlib import Path

import numpy as np
import pytest

from dpsearch import configs
from dpsearch.pomdp.solvers.agents import Controller
from dpsearch.pomdp.solvers.exact import exact_metrics
from dpsearch.pomdp.solvers.play import play
from scripts.experiments.pomdps.hand_written import HAND_WRITTEN, most_likely_state, qmdp, tiger_controller
from tests.support.optima import OPTIMAL, TASKS, assert_as_printed, task


@pytest.mark.parametrize("name", OPTIMAL)
def test_hand_written_controllers_are_optimal(name: str) -> None:
    played = task(name)
    agent = HAND_WRITTEN[name.split(",")[0].split()[0]](played.pomdp)
    assert isinstance(agent, Controller)
    assert_as_printed(exact_metrics(played, agent), OPTIMAL[name])


@pytest.mark.parametrize(
    ("name", "lead", "row"),
    [
        ("tiger", 1, "-375.000 -3.75000 -3.75000 -13.42857 100"),
        ("tiger", 3, "96.039 0.96039 0.96039 0.59565 100"),
        ("tiger, single", 3, "5.15992 0.98493 1.18516 0.44737 5.23887"),
    ],
)
def test_a_tiger_controller_opens_at_its_lead(name: str, lead: int, row: str) -> None:
    assert_as_printed(exact_metrics(task(name), tiger_controller(lead)), row)


def test_a_tiger_controller_needs_a_lead() -> None:
    with pytest.raises(ValueError, match="at least 1, got 0"):
        tiger_controller(0)


@pytest.mark.parametrize(("name", "optimum"), [("maze4x3", 0.7620), ("maze4x3, minus ends", 0.6976)])
def test_qmdp_is_nearly_optimal_in_the_4x3_maze(name: str, optimum: float) -> None:
    played = task(name)
    found = play(played, HAND_WRITTEN["maze4x3"](played.pomdp), 10_000).metrics().episode_return
    assert found.value > optimum - 0.01 - 4 * found.standard_error


def test_in_maze89_the_most_likely_state_leads_to_the_goal_where_qmdp_gets_stuck() -> None:
    played = task("maze89")
    likely = play(played, most_likely_state(played.pomdp), 2_000)
    stuck = play(played, qmdp(played.pomdp), 2_000)
    assert likely.terminated.mean() > 0.995
    assert 45 <= np.median(likely.lengths) <= 52  # 25 is possible, 29 is what a person needed
    assert stuck.terminated.mean() == pytest.approx(0.042, abs=0.02)


def test_every_finite_pomdp_has_a_hand_written_policy_under_the_name_of_its_config() -> None:
    assert {name.split(",")[0].split()[0] for name in TASKS} == set(HAND_WRITTEN)
    files = {path.stem for path in (Path(configs.__file__).parent / "env").glob("*.yaml")}
    assert set(HAND_WRITTEN) <= files
