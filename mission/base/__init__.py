"""What every other package of `mission` may use, and what uses none of them."""
