"""Messages and requests that nobody can read, sent to a run."""
