"""Libraries of C beside the Python that uses them: how they are built, found and called."""
