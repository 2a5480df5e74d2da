"""The live dashboard: a process of its own that reads the campaign database and never holds up a campaign.

::

    watcher.py    reads the database, once for all who look
    view.py       what is seen, as plain values: banner, progress, limits, links, verdict    (pure)
    charts.py     the pictures, bounded in size however long a campaign is                   (pure)
    asking.py     pause, resume, abort: as requests through the database
    guard.py      who may look and who may ask: addresses, token, cross-site requests
    pages.py      the pages, put together from the above and templates/
    server.py     the process
"""
