"""What an inspector keeps: ``dents.json``, ``dents.csv`` and one page, ``report.html``."""

from ftp_dent_ros.inspection.report.content import Frame, Report, View, content_id
from ftp_dent_ros.inspection.report.files import write_report

__all__ = ['Frame', 'Report', 'View', 'content_id', 'write_report']
