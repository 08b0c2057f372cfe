"""The service: one folder a concern; imports run one way, from `commands` down to `security` and `run`."""
