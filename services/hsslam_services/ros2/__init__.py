"""ROS 2 without ROS: messages in CDR, and keys, tokens and attachments of rmw_zenoh."""
