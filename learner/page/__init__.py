"""The page of a training in a browser: a process of its own that reads the bus as the terminal view does.

- `source`: the run as the source of a page: its learner's status, and its commands.
- `curves`: figures over updates, thinned evenly, however long the run is; `history` reads those from before the page.
- `episodes`: the views of episodes that somebody looks at, and the evaluations world by world, as channels.
- `process`: the page as a child of the learner; `cli`: `hd-learner page`.
"""
