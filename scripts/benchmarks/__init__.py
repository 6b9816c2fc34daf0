"""Every speed and size that the project promises, by name."""

from collections.abc import Callable

from scripts.benchmarks.files import pomdp_file
from scripts.benchmarks.measurement import Measurement
from scripts.benchmarks.processes import compilation, memory, startup
from scripts.benchmarks.searching import population, search
from scripts.benchmarks.simulator import torcs
from scripts.benchmarks.speed import driving, sampling, update

BENCHMARKS: dict[str, Callable[[int], list[Measurement]]] = {
    "sampling": sampling,
    "driving": driving,
    "torcs": torcs,
    "update": update,
    "population": population,
    "search": search,
    "pomdp_file": pomdp_file,
    "startup": startup,
    "memory": memory,
    "compilation": compilation,
}
"""Each takes a number of repetitions."""
