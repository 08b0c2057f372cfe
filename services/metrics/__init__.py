"""The run in numbers over HTTP on loopback: `/metrics` for Prometheus, `/healthz` for whoever restarts."""
