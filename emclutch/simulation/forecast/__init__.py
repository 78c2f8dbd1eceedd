"""What is known of a run before its first step: field, torque, cost, and what the effects that are off would matter."""
