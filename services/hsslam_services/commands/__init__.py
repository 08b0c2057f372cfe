"""What a user types: one module a command, with its options beside it."""
