"""Images of ROS 2 cameras: from messages to colour and depth, and pairs of the two."""
