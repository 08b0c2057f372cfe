"""Publishes the results of the tracker: poses and keyframes on the bus and in the pose log, events."""
