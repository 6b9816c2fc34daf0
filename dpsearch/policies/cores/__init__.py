"""Recurrent cores: each is one class in one file, with its torch module and its compiled twin."""

from dpsearch.policies.cores.base import Core
from dpsearch.policies.cores.elman import Elman
from dpsearch.policies.cores.gru import GRU
from dpsearch.policies.cores.lstm import LSTM
from dpsearch.policies.cores.memoryless import Memoryless

CORES: dict[str, type[Core]] = {"lstm": LSTM, "gru": GRU, "elman": Elman, "none": Memoryless}
"""The cores by their names in settings, ``policy.core``."""

__all__ = ["CORES", "GRU", "LSTM", "Core", "Elman", "Memoryless"]
