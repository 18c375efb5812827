"""Turn a fixed camera into a metric sensor."""
