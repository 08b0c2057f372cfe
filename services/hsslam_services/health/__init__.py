"""What is known of a run, and who is told: status, metrics, the status line."""
