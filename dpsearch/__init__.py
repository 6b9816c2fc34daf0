"""Direct policy search: algorithms that learn a policy without learning values first.

The public names below are imported on first use, so that ``import dpsearch`` costs nothing and
``import dpsearch.envs`` needs no PyTorch.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dpsearch.algos.lrwr import LRWR as LRWR
    from dpsearch.algos.lrwr import LRWRConfig as LRWRConfig
    from dpsearch.algos.policy_search import CMAESPolicySearch as CMAESPolicySearch
    from dpsearch.algos.policy_search import FEMPolicySearch as FEMPolicySearch
    from dpsearch.algos.policy_search import NESPolicySearch as NESPolicySearch
    from dpsearch.algos.policy_search import SNESPolicySearch as SNESPolicySearch
    from dpsearch.algos.policy_search import XNESPolicySearch as XNESPolicySearch
    from dpsearch.algos.rpg.config import RPGConfig as RPGConfig
    from dpsearch.algos.rpg.rpg import RPG as RPG
    from dpsearch.policies import PolicyConfig as PolicyConfig
    from dpsearch.policies import PolicyRunner as PolicyRunner
    from dpsearch.policies import RecurrentPolicy as RecurrentPolicy
    from dpsearch.report.generalisation import generalisation_test as generalisation_test
    from dpsearch.rollout import make_rollouts as make_rollouts

    __version__: str

# Public name -> the module it comes from: the imports above, for the interpreter.
_HOMES = {
    "CMAESPolicySearch": "dpsearch.algos.policy_search",
    "FEMPolicySearch": "dpsearch.algos.policy_search",
    "LRWR": "dpsearch.algos.lrwr",
    "LRWRConfig": "dpsearch.algos.lrwr",
    "NESPolicySearch": "dpsearch.algos.policy_search",
    "PolicyConfig": "dpsearch.policies",
    "PolicyRunner": "dpsearch.policies",
    "RPG": "dpsearch.algos.rpg.rpg",
    "RPGConfig": "dpsearch.algos.rpg.config",
    "RecurrentPolicy": "dpsearch.policies",
    "SNESPolicySearch": "dpsearch.algos.policy_search",
    "XNESPolicySearch": "dpsearch.algos.policy_search",
    "generalisation_test": "dpsearch.report.generalisation",
    "make_rollouts": "dpsearch.rollout",
}

__all__ = [
    "LRWR",
    "RPG",
    "CMAESPolicySearch",
    "FEMPolicySearch",
    "LRWRConfig",
    "NESPolicySearch",
    "PolicyConfig",
    "PolicyRunner",
    "RPGConfig",
    "RecurrentPolicy",
    "SNESPolicySearch",
    "XNESPolicySearch",
    "__version__",
    "generalisation_test",
    "make_rollouts",
]

# In a checkout, envs/ and configs/ stand beside this package; once installed, inside it.
_root = Path(__file__).parent.parent
if (_root / "pyproject.toml").is_file() and (_root / "envs" / "__init__.py").is_file():
    __path__.append(str(_root))


def __getattr__(name: str) -> object:
    value: object
    if name == "__version__":
        value = _version()
    elif name in _HOMES:
        value = getattr(import_module(_HOMES[name]), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value  # found directly from now on
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("dpsearch")
    except PackageNotFoundError:  # a checkout that was never installed
        return "0+unknown"
