"""The app: calibration in a browser, served on this computer only (extra ``app``).

A request passes :mod:`security` and :mod:`limits`; :mod:`routes` calls the :mod:`manager`, :mod:`uploads` or
:mod:`calibrator`, which change the plain data of :mod:`sessions`. Long work (:mod:`inspection`, :mod:`video`,
:mod:`solving`, :mod:`downloads`) runs in a :mod:`process_pool`. Changes are sent to the open pages as events
(:mod:`session_state`).
"""
