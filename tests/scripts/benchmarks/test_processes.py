import numpy as np

from scripts.benchmarks import probes, processes


def test_a_probe_runs_in_a_process_of_its_own_and_says_how_much_memory_it_had() -> None:
    numbers = processes.probe("longest_corridor")
    assert numbers["peak"] > 20.0
    assert numbers["build"] > 0.0


def test_the_peak_of_memory_is_in_mebibytes() -> None:
    before = probes.peak_memory()
    block = np.ones(100 * 2**17)  # 100 MiB
    assert probes.peak_memory() >= before
    assert 100.0 < probes.peak_memory() < 100_000.0
    del block
