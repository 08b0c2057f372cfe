"""An IMU: readings at the stamps of frames, gravity, the gyroscope's bias, a simulation."""
