"""Federated learning: communities of devices, their rounds, aggregation, fairness."""
