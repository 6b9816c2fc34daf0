"""Action heads: each is one class in one file, with its torch code and its compiled twins."""

from dpsearch.policies.heads.base import Head
from dpsearch.policies.heads.categorical import Categorical
from dpsearch.policies.heads.deterministic import Deterministic
from dpsearch.policies.heads.gaussian import Gaussian

__all__ = ["Categorical", "Deterministic", "Gaussian", "Head"]
