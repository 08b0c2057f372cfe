"""Downloads of files and archives: resumed, checked, and moved into place when complete."""
