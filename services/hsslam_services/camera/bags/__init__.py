"""ROS bags, and recordings of RealSense cameras, as sources."""
