"""Activities: predicates composed over roles and time, in a catalogue or in words."""
