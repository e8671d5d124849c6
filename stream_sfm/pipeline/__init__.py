"""A replay: a log through the engine into sinks, with a summary."""
