import json
import multiprocessing
import time
from pathlib import Path

from scripts.experiments.jobs import Job, RunLog, batches, run_all
from scripts.experiments.learning import until_solved


def work(overrides: tuple[str, ...], seed: int) -> dict[str, float]:
    return {"solved": 1, "env_steps": seed}


def job(seed: int, config: str = "abc") -> Job:
    return Job("maze", "rpg", config, ("algo=rpg",), seed, work)


def test_outcomes_come_back_from_the_log(tmp_path: Path) -> None:
    log = RunLog(tmp_path / "runs.jsonl")
    assert log.find([job(0)]) == {}
    for seed in (0, 2):
        log.add((job(seed),), [job(seed).run()])
    assert log.find([job(0), job(1), job(2)]) == {job(0): {"solved": 1, "env_steps": 0}, job(2): job(2).run()}


def test_other_settings_are_another_run(tmp_path: Path) -> None:
    log = RunLog(tmp_path / "runs.jsonl")
    log.add((job(0),), [job(0).run()])
    assert log.find([job(0, config="def")]) == {}


def test_a_line_that_was_cut_short_is_passed_over_and_spoils_none_after_it(tmp_path: Path) -> None:
    log = RunLog(tmp_path / "runs.jsonl")
    for seed in (0, 1):
        log.add((job(seed),), [job(seed).run()])
    log.path.write_bytes(log.path.read_bytes()[:-9])
    assert list(log.find([job(0), job(1)])) == [job(0)]
    log.add((job(2),), [job(2).run()])
    assert list(log.find([job(0), job(1), job(2)])) == [job(0), job(2)]


def test_a_line_says_all_that_tells_runs_apart(tmp_path: Path) -> None:
    log = RunLog(tmp_path / "runs.jsonl")
    log.add((job(3),), [job(3).run()])
    line = json.loads(log.path.read_text())
    assert line["key"] == {"task": "maze", "method": "rpg", "seed": 3, "config": "abc"}


def test_the_runs_of_a_batch_share_a_line_and_come_back_one_by_one(tmp_path: Path) -> None:
    log = RunLog(tmp_path / "runs.jsonl")
    batch = (job(0), job(2))
    log.add(batch, [{"solved": 1, "curve": [3, 1]}, {"solved": 0, "curve": []}])
    log.add((job(1),), [{"solved": 1, "curve": [2]}])
    first = json.loads(log.path.read_text().splitlines()[0])
    assert first["key"] == {"task": "maze", "method": "rpg", "config": "abc", "seeds": [0, 2]}
    assert first["outcomes"] == {"solved": [1, 0], "curve": [[3, 1], []]}
    assert log.find([job(seed) for seed in range(4)]) == {
        job(0): {"solved": 1, "curve": [3, 1]},
        job(1): {"solved": 1, "curve": [2]},
        job(2): {"solved": 0, "curve": []},
    }


def test_batches_are_of_one_cell_and_every_cell_gets_its_first_one_soon() -> None:
    jobs = [job(seed, config) for config in "ab" for seed in range(3)]
    found = [(batch[0].config, [one.seed for one in batch]) for batch in batches(jobs, 2)]
    assert found == [("a", [0, 1]), ("b", [0, 1]), ("a", [2]), ("b", [2])]


def test_runs_are_made_in_processes_that_end_when_no_more_are_wanted() -> None:
    overrides = ("algo=rpg", "env=tmaze", "env.corridor_length=1")
    jobs = [Job("maze", "rpg", "abc", overrides, seed, until_solved) for seed in range(1000)]
    runs = run_all(batches(jobs, 1), processes=1)
    done, (outcome,) = next(runs)
    assert set(done) <= set(jobs)
    assert outcome["solved"]
    assert len(multiprocessing.active_children()) == 1
    runs.close()
    deadline = time.monotonic() + 30.0
    while multiprocessing.active_children() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not multiprocessing.active_children()
