"""Small exact problems, without physics."""
