"""`hsslam-map`, `hsslam-mesh` and `hsslam-render`: work on a saved map, without the service."""
