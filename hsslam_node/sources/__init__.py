"""Where frames come from: files, the built-in room; and the noise of a sensor."""
