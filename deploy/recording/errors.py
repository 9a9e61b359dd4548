"""What can go wrong with recordings."""

from common.errors import HDError


class RecordingError(HDError):
    """A recording cannot be written or read; the text says what was expected and what came."""
