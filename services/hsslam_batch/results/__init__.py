"""The results of a batch: counts, a table with a row a log, a comparison with another batch."""
