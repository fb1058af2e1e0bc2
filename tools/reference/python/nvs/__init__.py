"""A second decoder of the packet format, written from docs/format.md alone. Slow and short: numpy, no other package."""
