"""The error of a request that cannot be met, which the user can mend."""


class RunError(RuntimeError):
    """The request cannot be met; the message says why in one line."""
