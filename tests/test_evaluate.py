import re
import shutil
from dataclasses import dataclass
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from PIL import Image

import dpsearch.evaluate
from dpsearch.algos import RPG
from dpsearch.policies import PolicyRunner
from dpsearch.runs import EnvRecipe, load_policy, save_policy
from dpsearch.runs.playback import play_episode
from tests.application import train


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("runs") / "run"
    assert train("env.corridor_length=2", "seed=1", "total_steps=200000", f"run_dir={run}").code == 0
    return run


@dataclass
class Result:
    code: int
    out: str
    err: str


@pytest.fixture
def evaluate(run: Path, capsys: pytest.CaptureFixture[str]):  # type: ignore[no-untyped-def]
    def call(*arguments: object, path: Path = run) -> Result:
        code = 0
        try:
            dpsearch.evaluate.main([str(argument) for argument in (path, *arguments)])
        except SystemExit as exit_:
            code = int(str(exit_.code))
        captured = capsys.readouterr()
        return Result(code, captured.out, captured.err)

    return call


def test_it_says_what_the_policy_achieves(evaluate) -> None:
    result = evaluate("--episodes", 50)
    assert result.code == 0
    assert re.search(r"^50 episodes of the stochastic policy$", result.out, re.M)
    assert re.search(r"^return: mean [\d.]+ ± [\d.]+, median [\d.]+, from \S+ to 4$", result.out, re.M)
    assert re.search(r"^length: mean [\d.]+, median [\d.]+, from 3 to \d+$", result.out, re.M)
