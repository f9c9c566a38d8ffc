"""Cameras, scenes and photographs with known truth, independent of all estimation code: truth is returned as arrays.

:mod:`~pinholify.simulation.lenses` map pixels to rays and points to pixels; :mod:`~pinholify.simulation.scene` defines
the scene, :mod:`~pinholify.simulation.rendering` traces rays into it, and :mod:`~pinholify.simulation.photograph`
models the sensor; :mod:`~pinholify.simulation.views` places boards; :mod:`~pinholify.simulation.datasets` and
:mod:`~pinholify.simulation.demo` combine them.
"""
