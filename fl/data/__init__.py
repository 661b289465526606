"""Tasks: images and labels, read from files or bundled, and spread over devices."""
