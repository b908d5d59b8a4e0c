"""Physics of the Gough–Stewart platform: geometry, kinematics, dynamics, kernel and stepping model."""
