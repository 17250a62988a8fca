"""Differential suite: every file of a folder is read by Impasto and by FFmpeg, Pillow or OpenEXR, and compared.

`make conformance MEDIA=FOLDER` prints a line for each difference and a count, and writes a table with `TABLE=FILE`. The
files are public collections that whoever runs it has fetched; none is part of the project.
"""
