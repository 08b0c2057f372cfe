"""Runs all logs of a batch on Ray: starts them, tries failed logs again, stops the batch."""
