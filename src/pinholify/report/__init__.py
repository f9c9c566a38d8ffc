"""Reports of a calibration: their contents, and the formats they are written in.

::

    from pinholify.report.contents import make_report
    from pinholify.report.evaluated import evaluated
    from pinholify.report.formats import render, write_report
    from pinholify.report.photographs import matched
    from pinholify.report.pictures import read_pictures
    from pinholify.report.provenance import provenance_of

    calibration = read_camera("camera.npz")
    evaluation, verdict = evaluated(calibration)
    photographs = matched([view.name for view in calibration.corner_set.views], paths)
    pictures = read_pictures(calibration, photographs.by_name, photographs.others)
    write_report("report.html", make_report(evaluation, verdict, provenance_of(Path("camera.npz")), pictures))
"""
