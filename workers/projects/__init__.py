"""Projects: the document that an artist edits, its checks, and the jobs that it stands for. No database, no HTTP."""
