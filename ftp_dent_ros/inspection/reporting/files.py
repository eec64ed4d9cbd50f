"""The report's three files, each whole or not there."""

from __future__ import annotations

import json
import os
from pathlib import Path

from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import written_aside
from ftp_dent_ros.inspection.reporting.content import Report
from ftp_dent_ros.inspection.reporting.page import page
from ftp_dent_ros.inspection.reporting.records import csv_text, report_record

PAGE, DATA, TABLE = 'report.html', 'dents.json', 'dents.csv'


def write_report(folder: str | os.PathLike[str], report: Report) -> Path:
    """Write dents.json, dents.csv and report.html into a folder; the path of the page.

    Raises
    ------
    ConfigurationError
        The folder cannot be written.
    """
    folder = Path(folder)
    record = report_record(report)
    texts = {
        DATA: json.dumps(record, indent=1, allow_nan=False) + '\n',
        TABLE: csv_text(record),
        PAGE: page(report),
    }
    try:
        for name, text in texts.items():
            with written_aside(folder / name) as aside:
                aside.write_text(text, encoding='utf-8', errors='backslashreplace')
    except OSError as reason:
        raise ConfigurationError(
            f'{folder}: the report cannot be written ({reason.strerror}): name another folder'
        ) from None
    return folder / PAGE
