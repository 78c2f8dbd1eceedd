"""The price of accuracy: ladders of numerical settings, cheapest settings for a wanted accuracy, what effects add."""
