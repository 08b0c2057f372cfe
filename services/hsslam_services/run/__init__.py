"""What a run is: its options, folder, shared memory, map state and summary."""
