"""Fields of the array `keyframes`, [16] int64; apart, as the store and its poses both read it."""

COUNT, POSE_VERSION, INHERITED, MOST, REFUSED, APPENDING, GRAVITY, WANTED = range(8)
