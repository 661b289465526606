"""What can go wrong before a library is there."""


class LibraryError(Exception):
    """A library cannot be loaded, or not as asked; the message is for the user."""
