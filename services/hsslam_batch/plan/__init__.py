"""The plan of a batch: the logs below a folder, and one configuration for all of them."""
