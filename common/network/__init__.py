"""The networks over ragged graphs: packed batches, attention, encoder, decoders, policy."""
