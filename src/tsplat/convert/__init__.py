"""`tsplat convert`: scenes read, edited and written in another format, and an account of it."""
