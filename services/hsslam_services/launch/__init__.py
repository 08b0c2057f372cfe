"""How a process of a run is started, watched and restarted: the supervisor's end and the process's own."""
