"""The processes of a run, one file each: subscriptions, loop, publications."""
