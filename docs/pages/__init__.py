"""Pages that are made from the code, and what all pages are checked for."""
