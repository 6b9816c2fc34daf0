import numpy as np

from dpsearch.policies import Categorical, Deterministic, RecurrentPolicy


def test_only_one_policy_whose_actions_are_random_plays_in_single_precision() -> None:
    policy = RecurrentPolicy(3, Categorical([4]))
    compiled, vector = policy.compiled(), policy.vector()
    assert compiled.pack(vector, greedy=False).dtype == np.float32
    assert compiled.pack(vector, greedy=True).dtype == np.float64
    assert compiled.pack(vector[None], greedy=False).dtype == np.float64
    np.testing.assert_array_equal(compiled.pack(vector, greedy=False), compiled.pack(vector, greedy=True))
    steady = RecurrentPolicy(3, Deterministic(1))  # whose actions are not random, whether greedy or not
    assert steady.compiled().pack(steady.vector(), greedy=False).dtype == np.float64
