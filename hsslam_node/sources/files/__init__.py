"""Files on disk: images, cameras, time stamps, and the layouts that sources share."""
