"""Bags: record, replay, recover."""
