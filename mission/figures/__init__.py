"""Every picture, described once and rendered for its two places: a file, and a page's card."""
