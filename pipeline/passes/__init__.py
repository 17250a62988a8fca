"""Render passes: named planes beside a picture, as renderers write them.

names        table of the names of passes, by program
find         the pass of a kind in one image; planes of depth, normals, positions, texture coordinates, object ids
vectors      motion vectors: units, signs and direction; one-way vectors completed
cryptomatte  soft mattes by object name
facts        what a sequence holds, found from its headers and two frames, for users and methods
sequence     passes of a sequence frame by frame: motion, mattes, ids and data
"""
