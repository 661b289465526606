"""Pictures as PNG files (the home of matplotlib, with `sweep.outcome.figures`)."""
