"""Projects: the document that an artist edits, its checks, and the jobs that it describes. No database, no HTTP."""
