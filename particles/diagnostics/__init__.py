"""What the grains look like and carry, as pure functions of grains and contacts: nothing here changes a state."""
