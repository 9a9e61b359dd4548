"""The bridge: topics in, the decision loop, commands and lifecycle, topics out."""
