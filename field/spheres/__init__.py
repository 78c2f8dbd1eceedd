"""Two equal magnetised spheres: the lone sphere's law, the pair by finite elements, and a table of pairs."""
