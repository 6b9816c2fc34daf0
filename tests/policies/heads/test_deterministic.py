"""The deterministic head has actions and no probabilities."""

from __future__ import annotations

import pytest
import torch

from dpsearch.policies import Deterministic


def test_a_deterministic_head_has_no_probabilities() -> None:
    outputs = torch.zeros(1, 2)
    head = Deterministic(2)
    assert torch.equal(head.sample(outputs, torch.zeros(1, 0)), head.mode(outputs))
    with pytest.raises(TypeError, match="no log-probabilities"):
        head.log_prob(outputs, outputs)
    with pytest.raises(TypeError, match="no entropy"):
        head.entropy(outputs)
    with pytest.raises(TypeError, match="no entropy"):
        head.cross_entropy(outputs, outputs)
