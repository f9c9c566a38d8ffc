"""Cameras, scenes and photographs with known truth. Knows nothing of estimation: truth leaves as arrays.

:mod:`~pinholify.simulation.lenses` turn pixels into rays and points into pixels;
:mod:`~pinholify.simulation.scene` is what there is to see; :mod:`~pinholify.simulation.rendering` traces the
one into the other and :mod:`~pinholify.simulation.photograph` adds what a sensor does;
:mod:`~pinholify.simulation.views` places boards; :mod:`~pinholify.simulation.datasets` and
:mod:`~pinholify.simulation.demo` put it all together.
"""
