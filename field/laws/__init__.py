"""B-H laws of steels, metals and powder, by name, from tables and by formula; conductivities."""
