"""The one way in which looking for a board fails."""


class NotFoundError(Exception):
    """There is no usable board in a photograph; the message says why."""
