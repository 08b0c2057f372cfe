"""What lies on disk: images, cameras, time stamps, and the folders and files that readers share."""
