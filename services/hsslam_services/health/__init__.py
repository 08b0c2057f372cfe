"""The state of a run and its outputs: status, metrics, the status line."""
