"""The drive in simulation: plant, inverter, sensors, and the generated controller in the loop."""
