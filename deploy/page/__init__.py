"""The page of robots: what their bridges tell, and their commands, in a browser (docs/deploy/page.md)."""
