"""A map as the contents of files that other tools read; nothing here opens a file."""
