"""Virtual sensors: what a laser or a proximity sensor would see on a floor. No CORBA here."""
