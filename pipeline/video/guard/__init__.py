"""Untrusted media are decoded in child processes, which may hang, crash or exhaust their memory without harm.

decoder_server   starts the decoder server, which forks decoder processes
decoder_process  talks to a decoder process
server_main      entry point of the decoder server
roles            loop of the server, and the roles of its children
wire             message format: JSON and bytes, arrays in shared memory; never pickle
reader           `GuardedReader`: a `VideoReader` in a decoder process
files            numbered images, and joining with the source's sound
pictures         pictures of a shot, also with named planes
"""
