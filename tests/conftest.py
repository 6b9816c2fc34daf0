"""For all tests."""

import pytest
import torch


@pytest.fixture(autouse=True, scope="session")
def one_torch_thread() -> None:
    """One thread is the fastest at the sizes here, and several get in each other's way on a busy machine."""
    torch.set_num_threads(1)
