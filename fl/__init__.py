"""Federated learning over an unreliable radio: devices, data and probabilities, no flight."""
