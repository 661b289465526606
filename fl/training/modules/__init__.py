"""Networks as torch modules (the home of torch): users' own, and on a GPU the built-in ones."""
