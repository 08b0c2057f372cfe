"""Reading logs: opens their files, and finds messages, poses and frames in them."""
