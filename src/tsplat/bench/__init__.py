"""How fast scenes are drawn here, and how near that is to what the machine can do: `tsplat bench`.

`command` reads the arguments, `views` says where from, `measure` draws and keeps the times, `results` works out
what follows, `report` and `document` show it to a person or a program. Knows nothing about how stages work.
"""
