"""`tsplat record`: an orbit or a session, as an asciicast or a moving picture."""
