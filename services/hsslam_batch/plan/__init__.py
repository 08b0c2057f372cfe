"""What a batch consists of: the logs below a folder, and one configuration for all of them."""
