"""An IMU: what it says at the stamp of a frame, gravity, the gyroscope's bias, a simulated one."""
