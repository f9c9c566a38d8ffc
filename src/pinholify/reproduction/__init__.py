"""The paper, reproduced: its six cameras rendered, its two tables and its figures made anew from pixels.

:mod:`~pinholify.reproduction.run` does it all; :mod:`~pinholify.reproduction.chain` takes one data set from rendered
photographs to numbers; :mod:`~pinholify.reproduction.truth` compares them with what was rendered; tables, findings,
figures and page show them. The paper: De Boi, Pathak, Oliveira, Penne, *How to turn your camera into a perfect
pinhole model*, 2023.
"""
