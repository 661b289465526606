"""Federated learning over an unreliable radio. Knows devices, data and probabilities, not flight."""
