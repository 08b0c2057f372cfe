"""Who may connect to the router of a run, and what each may do there."""
