"""Map editor domain: buildings, their rules, their storage and their file formats. No CORBA here."""
