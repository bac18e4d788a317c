"""One file a figure: its first line says what it shows, and `FIGURE` how it is drawn."""
