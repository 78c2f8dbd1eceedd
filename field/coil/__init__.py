"""The coil as a part of a circuit: winding, inductance, flux-driven solves, magnetic circuits."""
