"""ROS 2 without ROS: messages in CDR, and rmw_zenoh's keys, tokens and attachments for what goes out."""
