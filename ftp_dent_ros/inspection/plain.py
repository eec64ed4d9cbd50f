"""A dent as plain data that JSON holds, and back."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from ftp_dent_ros.inspection.dent import Estimate, MeasuredDent

# Decimals of outlines and profiles, metres: they are for drawing.
_DRAWN = 7


def dent_to_plain(dent: MeasuredDent) -> dict[str, Any]:
    """Every field; estimates as value and uncertainty."""
    record: dict[str, Any] = {}
    for field in fields(dent):
        value = getattr(dent, field.name)
        if isinstance(value, Estimate):
            value = [value.value, value.uncertainty]
        elif isinstance(value, np.ndarray):
            value = (np.round(value, _DRAWN) if value.ndim == 2 else value).tolist()
        elif isinstance(value, np.generic):
            value = value.item()
        record[field.name] = value
    return record


def dent_from_plain(record: dict[str, Any]) -> MeasuredDent:
    """The dent again.

    Raises
    ------
    KeyError, TypeError, ValueError
        It is no such record.
    """
    values = dict(record)
    for field in fields(MeasuredDent):
        value = values[field.name]
        if field.type == 'Estimate':
            values[field.name] = Estimate(*value)
        elif field.type in ('Vector', 'Points'):
            shape = (-1, 2) if field.name.endswith('profile') else (-1, 3)
            array = np.array(value, float)
            values[field.name] = array if field.type == 'Vector' else array.reshape(shape)
    return MeasuredDent(**values)
