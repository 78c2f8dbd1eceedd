"""Files that ParaView reads."""
