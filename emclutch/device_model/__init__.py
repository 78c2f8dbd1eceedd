"""The device of a scene: shape, walls, mesh, materials, coil and its current."""
