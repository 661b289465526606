"""Native loops of the planner: first plans, branch and bound, local search, evaluation."""
