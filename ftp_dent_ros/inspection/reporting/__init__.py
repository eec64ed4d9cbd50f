"""What an inspector keeps: ``dents.json``, ``dents.csv`` and one page, ``report.html``."""
