"""What a terminal was asked, what it said, and what follows: `tsplat doctor`, the heart of a bug report.

`command` reads the arguments, `examination` asks and makes a plain document of it, `report` shows that.
"""
