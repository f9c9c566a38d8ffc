"""The app: calibration in a browser, on this computer alone (extra ``app``).

One way through: a request passes :mod:`security` and :mod:`limits`, :mod:`routes` hand it to the :mod:`studio`, which
changes the plain data of :mod:`sessions` and lets processes of :mod:`work` do what takes time (:mod:`looking`,
:mod:`video`, :mod:`solving`, :mod:`downloads`). What changes is told to the open pages as events.
"""
