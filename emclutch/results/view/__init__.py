"""Looking at a run in space: a script for ParaView, and pyvista."""
