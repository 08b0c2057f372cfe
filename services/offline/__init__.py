"""Commands that work on a saved map, without the service."""
