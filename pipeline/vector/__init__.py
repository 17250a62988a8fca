"""Label maps as vector outlines (zhang2011online, section 7)."""
