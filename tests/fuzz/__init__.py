"""Random scenes, lights and cameras for all methods, with what must hold whatever they are.

- `scenes`: cases from a seed, as plain data that prints as a program;
- `brute`: the visibility of a few points in ``float64``, by code that shares nothing with the
  package;
- `checks`: what must hold, and the table of what is known not to;
- `smaller`: what is left of a failing case when everything that does not matter is taken away;
- `__main__`: ``make fuzz SECONDS=3600 SEED=0``.
"""
