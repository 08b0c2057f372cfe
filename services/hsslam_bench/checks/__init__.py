"""The rows of the benchmark: what each measures, and its bound."""
