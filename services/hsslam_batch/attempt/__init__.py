"""One log, one process group: started, watched, checked, committed."""
