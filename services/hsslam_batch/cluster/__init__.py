"""All logs of a batch on Ray: which may start, which are tried again, when it is over."""
