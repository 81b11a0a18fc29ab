"""`tsplat optimize`: a scene written with its levels of detail, to be drawn without being read whole."""
