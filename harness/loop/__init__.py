"""The sampled loop around a plant: timing, sensors, actuators."""
