"""Messages and requests that no process can read, sent to a run."""
