"""Reproduction of the paper: its six cameras are rendered, and its two tables and its figures recomputed from pixels.

:mod:`~pinholify.reproduction.run` runs everything; :mod:`~pinholify.reproduction.chain` takes one data set from
rendered photographs to numbers; :mod:`~pinholify.reproduction.truth` compares them with the rendered truth; tables,
findings, figures and page present them. The paper: De Boi, Pathak, Oliveira, Penne, *How to turn your camera into a
perfect pinhole model*, 2023.
"""
