"""The paper's planner: schedule and path in alternation."""
