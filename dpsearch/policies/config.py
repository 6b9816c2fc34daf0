"""The settings of a policy: its architecture and its initial weights."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dpsearch.policies.cores import CORES


@dataclass
class PolicyConfig:
    """The architecture of a policy and its initial weights.

    Attributes:
        core: ``"lstm"``, ``"gru"``, ``"elman"`` (Elman's recurrent network of tanh units) or ``"none"`` (a layer of
            tanh units without memory).
        hidden_size: Units H of the core; the thesis uses 10.
        bias: Whether core and read-out have biases.
        init_range: Weights and biases start uniform in [-init_range, init_range] (thesis: 0.01).
        forget_bias: Added to the initial biases of the gates that keep a unit's content: an LSTM's forget gates, a
            GRU's update gates. A unit keeps sigmoid(forget_bias) of its content from one step to the next: half with
            biases near 0, 99.97% with 8. In a GRU what is not kept is replaced, so it also writes as much less.
        input_bias: Added to the initial biases of an LSTM's input gates; a negative one keeps cells from filling up
            with inputs that are there at every step.
        readout: False leaves the linear read-out away: the activations of the first units are the outputs, as in a
            fully recurrent network without a layer of its own for the output.
        previous_action: Whether the policy also sees its previous action, one-hot if discrete, zeros at first. A
            policy that samples its actions cannot otherwise know which it took.
        init_std: Initial standard deviation of a Gaussian policy, in (0, 1); None for one half, since all weights are
            small.
        noise_memory: Autocorrelation of a Gaussian policy's exploration noise, an AR(1) process, in [0, 1). The head's
            standard deviation sigma is that of the process's innovations; the noise as a whole has
            sigma / sqrt(1 - noise_memory^2). Independent noise cancels in what is heavy, noise that lasts moves it
            (Wawrzynski, IJMLC 2015). The policy remembers its noise, so that actions are still Gaussian given the
            history.
    """

    core: str = "lstm"
    hidden_size: int = 10
    bias: bool = True
    init_range: float = 0.01
    forget_bias: float = 0.0
    input_bias: float = 0.0
    readout: bool = True
    previous_action: bool = False
    init_std: float | None = None
    noise_memory: float = 0.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names the setting if a value is out of range."""
        if self.core not in CORES:
            raise ValueError(f"core must be one of {', '.join(CORES)}, got {self.core!r}")
        if self.hidden_size < 1:
            raise ValueError(f"hidden_size must be at least 1, got {self.hidden_size}")
        if not (math.isfinite(self.init_range) and self.init_range >= 0.0):
            raise ValueError(f"init_range must be finite and at least 0, got {self.init_range}")
        for name, added in self.gate_biases.items():
            if not math.isfinite(added):
                raise ValueError(f"{name} must be finite, got {added}")
            if added and not (self.bias and name in CORES[self.core].gate_biases):
                able = " or ".join(core for core, kind in CORES.items() if name in kind.gate_biases)
                raise ValueError(f"{name} needs core {able}, with biases, got core {self.core}, bias {self.bias}")
        if self.init_std is not None and not 0.0 < self.init_std < 1.0:
            raise ValueError(f"init_std must be in (0, 1), got {self.init_std}")
        if not 0.0 <= self.noise_memory < 1.0:
            raise ValueError(f"noise_memory must be at least 0 and below 1, got {self.noise_memory}")

    @property
    def gate_biases(self) -> dict[str, float]:
        """Settings that are added to the initial biases of a core's gates."""
        return {"forget_bias": self.forget_bias, "input_bias": self.input_bias}
