"""A lost camera moves on: it is tracked in a fragment beside the map, which joins the map where they meet."""
