"""One file a process: what it hears, its loop, what it publishes."""
