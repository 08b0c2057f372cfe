"""What Foxglove draws: messages of the bus in its own schemas."""
