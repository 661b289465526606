"""Logs in other programs' formats: CSV, Parquet, KML, MAVLink telemetry logs."""
