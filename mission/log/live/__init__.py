"""The log's topics over a WebSocket while the run goes on."""
