"""Virtual sensors: simulated scans of laser and proximity sensors on a floor. No CORBA here."""
