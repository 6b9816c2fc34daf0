"""The constant baseline: a moving average of returns."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest
import torch

from dpsearch.algos.baselines.constant import ConstantBaseline, ConstantConfig
from dpsearch.policies import Categorical, RecurrentPolicy

NOTHING = torch.empty(0)


def baseline(episodes: int) -> ConstantBaseline:
    return ConstantBaseline(ConstantConfig(episodes), RecurrentPolicy(2, Categorical([2])), seed=0)


def test_it_is_the_mean_return_of_the_last_episodes_before_the_batch() -> None:
    three, copy = baseline(3), baseline(3)
    returns = np.array([[1.0, 2.0, 3.0, 4.0], [1.0, 0.0, 3.0, 0.0]], np.float32)
    played = mock.Mock(lengths=np.array([2, 1, 2, 1]))
    assert three(played, NOTHING, returns)[0] == 0.0
    expected = (2.0 + 3.0 + 3.0 + 4.0) / 4  # the first of the four episodes has left the window
    assert three(played, NOTHING, returns)[0] == pytest.approx(expected)
    copy.load_state_dict(three.state_dict())
    assert copy(played, NOTHING, returns)[0] == three(played, NOTHING, returns)[0]
    counted = np.array([[True, True, False, True], [False, False, True, False]])
    copy(played, NOTHING, returns, counted)
    assert copy.expected(played, NOTHING) == pytest.approx((2.0 + 3.0 + 4.0) / 3)


def test_over_no_episodes_it_is_zero() -> None:
    none, played = baseline(0), mock.Mock(lengths=np.array([1]))
    none(played, NOTHING, np.ones((1, 1), np.float32))
    assert none.expected(played, NOTHING) == 0.0
