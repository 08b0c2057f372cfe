"""What comes from ROS 2 cameras, once it is decoded: images and which of them belong together."""
