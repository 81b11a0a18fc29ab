"""`tsplat cache`: the levels of detail that are kept between runs, and how to be rid of them."""
