"""Errors of building and loading native libraries."""


class LibraryError(Exception):
    """A library cannot be built or loaded, or not as asked; the message is for the user."""
