"""Everything that may fail while a run trains, tried on real processes: ``make faults``, docs/faults.md."""
