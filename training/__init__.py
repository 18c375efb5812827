"""Training of the orientation network: data, model, training, export. Needs torch; not packaged."""
