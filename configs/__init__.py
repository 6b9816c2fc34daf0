"""The configuration files, for Hydra to find as ``pkg://dpsearch.configs``."""

if __name__ != "dpsearch.configs":  # as for dpsearch.envs: one name only
    raise ImportError(f"this package is called dpsearch.configs: import that, not {__name__}")
