"""Cameras of ROS 2, heard over zenoh as rmw_zenoh sends them."""
