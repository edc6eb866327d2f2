"""The system in Foxglove: its messages from floors, scans, postures and missions, live and in MCAP files."""
