"""Who is near whom: neighbours, contacts and their history."""
