"""Cost of accuracy: errors of numerical settings, cheapest settings for a wanted accuracy, contributions of effects."""
