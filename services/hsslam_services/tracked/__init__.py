"""What the tracker process says of its results: poses and keyframes on the bus and in the log, events."""
