"""What goes into an FMU, and the archive itself: the same content gives the same bytes."""
