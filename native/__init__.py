"""What all packages share: libraries of C, how they are built, found and called; errors."""
