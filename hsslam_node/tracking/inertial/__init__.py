"""What an IMU tells the tracker, and what tracked frames tell of the IMU."""
