"""Settings on the command line that Hydra takes, but that mean nothing."""

from __future__ import annotations

from collections.abc import Sequence

from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig, OmegaConf

from dpsearch.errors import RunError


def check_booleans(overrides: Sequence[str], config: DictConfig) -> None:
    """Refuse numbers other than 0 and 1 for true and false: Hydra takes any of them for true.

    Args:
        overrides: Settings as the command line gives them.
        config: The configuration that was composed of them.

    Raises:
        RunError: If there is one.
    """
    for override in OverridesParser.create().parse_overrides(list(overrides)):
        key, value = override.key_or_group, override.value()
        number = isinstance(value, int | float) and not isinstance(value, bool) and value not in (0, 1)
        if number and isinstance(OmegaConf.select(config, key), bool):
            raise RunError(f"{key} must be true or false, got {value}")
