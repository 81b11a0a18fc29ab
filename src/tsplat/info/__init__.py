"""What a scene holds, how its values are spread and what looks wrong in it: `tsplat info`.

`command` reads the arguments; `measures` has a value for each splat, `distribution` sorts one of them, `findings`
judges them, `document` makes a plain document of it all; `report` shows that.
"""
