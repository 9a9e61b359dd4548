"""The paper's tables: what is trained, what is run, and what comes out, by one command."""
