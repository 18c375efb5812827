"""What every room speaks: geometry, cameras, people, tracks, errors, progress, files."""
