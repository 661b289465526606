"""Native loops of the planner: first plans, and branch and bound."""
