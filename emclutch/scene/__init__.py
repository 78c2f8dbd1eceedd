"""The scene: what a TOML file may say about a device, its grains and its motion, as frozen models in SI."""
