"""A second decoder of the packet format, by docs/format.md, without code of the library. Slow and short: only numpy."""
