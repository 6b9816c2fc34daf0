"""The error that is the user's to mend."""


class RunError(RuntimeError):
    """What was asked for cannot be done; the message says why in one line."""
